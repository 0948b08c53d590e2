"""Geometry of triangle meshes: vectors, the bounding-volume hierarchy, rays and distances.

In: vertices (n, 3) in metres and triangles (m, 3). Out: hits, distances and nearest points. Imports compiled kernels
and poses only.
"""
