"""The trial of a tracker: a tiny sequence, and every fault explained.

In: a tracker. Out: findings, and whether it is good. Imports config, inputs, external and third-party trackers.
"""
