"""Picking points of the model on the first image, in a page that this computer serves to itself.

In: a model, a camera and an image. Out: init.toml. Imports trackers.
"""
