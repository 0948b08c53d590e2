"""From parts to images: GL context, shaders, shadows, baked light, and the camera simulator.

In: renderable parts and a moving camera. Out: linear radiance, depth and instances at any time. Only this room knows
OpenGL's axes. Imports nothing of structures or datasets.
"""
