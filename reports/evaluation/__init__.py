"""`uavbench evaluate`: any two trajectories, whatever holds them, scored and drawn.

In: two files or folders. Out: errors with a record of how they were computed. Imports metrics.
"""
