"""Baselines: `hold` repeats the initial pose, `vo` is visual odometry without the model.

In: images. Out: poses. Imports the tracker protocol, and `shang_shen` for its greyscale conversion.
"""
