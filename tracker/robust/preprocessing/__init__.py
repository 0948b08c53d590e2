"""Preprocessing of images: denoising, contrast stretch, gain-offset compensation.

In: an image. Out: an image. Imports compiled kernels only.
"""
