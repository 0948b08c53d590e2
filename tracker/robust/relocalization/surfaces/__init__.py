"""Surfaces: what the structure looked like from places of the run, and the poses at which an image shows it so.

In: an image, surfaces, and poses about which to look. Out: aligned poses, the most alike first. Imports scoring.
"""
