"""Baselines: `hold` repeats the initial pose, `vo` knows nothing of the structure.

In: images. Out: poses. Imports the tracker protocol.
"""
