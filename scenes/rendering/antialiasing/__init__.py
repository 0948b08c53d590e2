"""Antialiasing of an image that was rendered with one sample per pixel, from the outlines of its triangles.

In: colours and facets at the pixel centres, and the corners of the facets. Out: the antialiased image, depth and
instances. Imports compiled kernels.
"""
