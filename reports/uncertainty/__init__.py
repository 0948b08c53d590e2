"""Consistency of claimed covariances: NEES of runs and of trajectory files, and their summary.

In: poses with covariances, and true poses. Out: NEES, its figures, and standard deviations of a pose. Imports no other
room of reports but metrics.
"""
