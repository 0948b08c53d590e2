"""What is learned of a camera from its images, where edges are located: its response, blur, sharpening and colours.

In: what the kernels of the steps of light measure at edges that stand alone. Out: the optics of the next frame. Imports
the kernels of edges.
"""
