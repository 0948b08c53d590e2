"""Faces of more than three corners, which trimesh cuts into fans: right for convex faces alone.

In: faces as a file has them. Out: triangles. Imports primitives and the limits of faces.
"""
