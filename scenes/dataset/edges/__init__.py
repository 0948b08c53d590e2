"""Samples along the model's edges in a view, for the ground truth of visible edges.

In: edges in the camera frame, depth. Out: samples in view, which of them are visible, and lines of files. Imports
compiled kernels.
"""
