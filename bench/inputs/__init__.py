"""Inputs of a result: files named by configs, plug-ins' and programs' files, and the content hash of it all.

In: specs and paths. Out: files, and hashes. Imports source files of trajectories only.
"""
