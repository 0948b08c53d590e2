"""Check of a tracker on a tiny sequence, with an explanation of every fault.

In: a tracker. Out: findings and a verdict. Imports config, inputs, external and third-party trackers.
"""
