"""Lossless image files: a PNG encoder whose output depends on the pixels alone.

In: images. Out: PNG files. Imports compiled kernels.
"""
