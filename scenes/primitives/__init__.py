"""Closed solids and small meshes that structures and environments are made of.

In: sizes in metres and materials. Out: renderable parts. Imports materials.
"""
