"""External trackers: programs in any language that get a folder or a stream of frames, never the ground truth.

In: a command and a sequence. Out: results and named faults. Imports inputs, the tracker protocol and datasets.
"""
