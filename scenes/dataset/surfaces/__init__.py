"""Surfaces in a frame: optical flow to the next frame, what it hides, and normals.

In: the scene and two poses of the camera. Out: images in the formats that readers of flow know. Imports rendering for
the geometry that each pixel shows.
"""
