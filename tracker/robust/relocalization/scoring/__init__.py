"""Scoring: how well the edges visible at a pose agree with the edge pixels of a small image.

In: an image and poses around which to look. Out: the poses that agree best. Imports edges.
"""
