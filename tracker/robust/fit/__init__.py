"""The fit of one image: control points and patches, from a predicted pose to one with its support, and what is learned.

In: an image and a prediction. Out: a fit. Imports edges, optics, patches and solver.
"""
