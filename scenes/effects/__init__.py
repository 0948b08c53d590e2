"""Effects on an image in physical order: shutter, lens, sensor, link.

In: linear images with their times, parameters and random generators. Out: 8-bit images. Imports rendering.
"""
