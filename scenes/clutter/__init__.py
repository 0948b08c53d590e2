"""Clutter: trees, people, birds and lookalikes, and their placement around the structure.

In: the structure's bounds, parameters and a random generator. Out: static and moving parts. Imports primitives,
materials and structures.
"""
