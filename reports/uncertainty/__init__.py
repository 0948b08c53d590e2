"""Consistency of claimed covariances: NEES of runs and of trajectory files, and their summary.

In: poses with covariances, and true poses. Out: NEES, its summary with the number of independent errors, and standard
deviations of a pose. Imports no other package of reports than metrics.
"""
