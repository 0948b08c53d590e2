"""What an OBJ file has beside its vertices: materials in libraries of their own, and faces of many corners.

In: lines of the file. Out: textures, and triangles. Imports primitives.
"""
