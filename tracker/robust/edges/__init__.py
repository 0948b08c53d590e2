"""Edges: which are visible, where control points lie on them, and the step of radiance at each.

In: the edge graph of the structure and a predicted pose. Out: candidates with offset, variance and weight. Imports
geometry kernels.
"""
