"""Trackers on real images: folders, videos and recorded sequences.

In: images, a model, a camera and an initial pose. Out: results like those of a suite, and an overlay video. Imports
trackers.
"""
