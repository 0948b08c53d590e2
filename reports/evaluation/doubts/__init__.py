"""Likely mistakes in what is evaluated: units, conventions, clocks, and files that do not belong together.

In: two trajectories and their matched poses, or the files they are of. Out: sentences. Imports metrics.
"""
