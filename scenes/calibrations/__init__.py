"""Calibrations that people give: `camera.toml`, those of other tools, whose conventions differ, and implausible ones.

In: a file or its beginning, a name of a lens, a camera's numbers. Out: values of a camera's fields, or what to do, for
people. Imports files of trajectories; nothing of scenes.
"""
