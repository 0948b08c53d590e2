"""Painted surfaces that tile, the procedural textures under them, and grain and patches over them.

In: a random generator. Out: textures as linear or coded images. Imports the pixel kernels of rendering only.
"""
