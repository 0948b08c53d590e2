"""`uavbench evaluate`: errors of an estimated trajectory against a reference, from files of any supported format.

In: two files, folders, arrays or DataFrames. Out: errors with a record of how they were computed, and figures. Imports
metrics and the figures' style.
"""
