"""Speed on models of many edges, as those from building information systems.

In: a facade of boxes, drawn without the renderer. Out: times of the start of runs and of their frames. Imports the
trackers, and the box and the camera of the other benchmarks.
"""
