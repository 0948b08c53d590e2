"""Manual picking of model points in the first image, on a page served on localhost only.

In: a model, a camera and an image. Out: init.toml. Imports trackers.
"""
