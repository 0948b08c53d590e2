"""`uavbench evaluate`: two trajectories of any format, scored and drawn.

In: two files or folders. Out: errors with a record of how they were computed. Imports metrics and the figures' style.
"""
