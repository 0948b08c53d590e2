"""The solver: hypotheses, M-estimation, and the filter of nuisance biases.

In: candidates and patches. Out: a pose update with its information. Imports geometry kernels.
"""
