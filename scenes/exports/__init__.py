"""Sequences in other tools' formats: EuRoC, TUM, KITTI, BOP, video, ROS 2 bags, COLMAP, nerfstudio.

In: a sequence folder. Out: what the other format can hold, and notes on what it cannot. Imports the dataset and its
rendering kernels.
"""
