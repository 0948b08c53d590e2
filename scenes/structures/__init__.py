"""Structures to inspect: box, wall, bridge, building, truss, checkerboard.

In: parameters and a random generator. Out: the structure as designed, with its edges, and the parts that are rendered
as built. Imports primitives, materials and model files.
"""
