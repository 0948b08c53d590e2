"""Trajectory files: TUM, EuRoC and KITTI.

In: paths. Out: trajectories whose numbers round-trip exactly, and errors that name the line. Imports poses and files.
"""
