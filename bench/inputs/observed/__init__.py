"""Inputs that no source shows: what users' code was seen to open, list and start while a job ran.

In: audit events of this process, and the task of a job. Out: the record of these inputs, and whether they are as they
were. Imports the analysis of sources and commands beside it, and source files of trajectories.
"""
