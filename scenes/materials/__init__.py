"""Painted surfaces that tile, and the procedural textures under them.

In: a random generator. Out: textures as linear or coded images. Imports the pixel kernels of rendering only.
"""
