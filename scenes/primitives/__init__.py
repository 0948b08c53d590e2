"""Closed solids and simple meshes from which structures and environments are built.

In: dimensions in metres and materials. Out: renderable parts. Imports materials.
"""
