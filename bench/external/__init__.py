"""External trackers: a program in any language, given a folder or a stream of frames, never the ground truth.

In: a command and a sequence. Out: results, and faults with names. Imports inputs, the tracker protocol and datasets.
"""
