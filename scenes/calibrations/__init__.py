"""Calibrations of other tools: how to write theirs as a `camera.toml`, whose conventions differ.

In: the beginning of a file, or a name of a lens. Out: what to do, for people. Imports nothing of scenes.
"""
