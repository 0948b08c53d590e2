"""Lossless images as files: an encoder whose bytes follow from the pixels alone.

In: images. Out: PNG files. Imports compiled kernels.
"""
