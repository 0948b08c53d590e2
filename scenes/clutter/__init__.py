"""Clutter: trees, people, birds, lookalikes, and where they are placed.

In: the structure, parameters and a random generator. Out: still and moving parts. Imports primitives, materials and
structures.
"""
