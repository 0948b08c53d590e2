"""ViSP's CAO format: polygons, cylinders and circles, in files that load each other.

In: a file in its folder, or a structure. Out: one piece of triangles, or a file. Imports pieces and limits of files.
"""
