"""Trajectory files: TUM, EuRoC and KITTI.

In: paths. Out: trajectories, exactly, with errors that name the line. Imports poses and files.
"""
