"""What shutter, lens, sensor and link do to an image, in the order of nature.

In: linear images with their times, parameters and random generators. Out: 8-bit images. Imports the camera simulator.
"""
