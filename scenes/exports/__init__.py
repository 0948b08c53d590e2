"""Export of sequences: EuRoC, TUM, KITTI, BOP, video, ROS 2 bags, COLMAP, nerfstudio.

In: a sequence folder. Out: a dataset in the other format, and notes on what the format cannot represent. Imports
the dataset and its rendering kernels.
"""
