"""Samples along the model's edges in a view, for the ground truth of visible edges.

In: edges in the camera frame, depth. Out: samples in view, and which of them are visible. Imports compiled kernels.
"""
