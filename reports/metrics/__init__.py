"""Metrics on trajectories and frames: association, alignment, APE, RPE, latency, model-space errors.

In: arrays of poses. Out: errors with units in their names, and their summaries. Imports no other package of reports.
"""
