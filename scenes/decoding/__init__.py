"""What decoders do not tell of images of others: the bits of their samples, and damage within JPEG files.

In: content of an image file. Out: grey levels of 8 bits, or what is wrong. Imports compiled kernels.
"""
