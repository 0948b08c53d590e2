"""`robust`: model edges and texture patches in one fit, with learned biases, loss and relocalization.

In: an image and its stamp. Out: a pose with covariance, or `lost`. Imports the tracker protocol and geometry kernels;
nothing of `shang_shen`.
"""
