"""Planar models of scanned meshes: the planes of a rough surface, and the polygons that they bound.

In: triangles of a laser scan or of photogrammetry. Out: few planar polygons with straight edges, as triangles, and how
well they fit. Imports the structure model and geometry; nothing of rendering.
"""
