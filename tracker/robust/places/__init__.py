"""Places: where a run had a pose, and the poses of later images by what was seen there.

In: images with their poses, later an image. Out: likely poses of that image. Imports edges, patches,
the solver, and poses as arrays.
"""
