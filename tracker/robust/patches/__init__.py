"""Texture patches on known planes: corners, and their alignment in later frames.

In: images and certain poses. Out: displacements with their information. Imports edges and geometry kernels.
"""
