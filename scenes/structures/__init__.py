"""Structures to inspect: box, wall, bridge, building, truss, checkerboard.

In: parameters and a random generator. Out: a built structure, its true edges and what is rendered of it. Imports
primitives, materials and model files.
"""
