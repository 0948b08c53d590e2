"""What a decoder does not tell of images of others: the bits of their samples.

In: content of an image file. Out: grey levels of 8 bits. Imports trajectories only.
"""
