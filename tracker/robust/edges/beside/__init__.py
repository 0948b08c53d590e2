"""What lies beside an edge on its structure: which way its faces go on, and which other faces cover or continue them.

In: the edges, faces and tree of triangles of a structure, once. Out: arrays of the edge map. Imports hidden lines of
edges.
"""
