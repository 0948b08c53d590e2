"""Sequences in the formats of others: EuRoC, TUM, KITTI, BOP, video.

In: a sequence folder. Out: what the other format can hold, and a word on what it cannot. Imports the dataset.
"""
