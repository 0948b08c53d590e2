"""What is done to an image before anything is measured in it: denoising, gain-offset compensation, contrast.

In: an image. Out: an image. Imports compiled kernels only.
"""
