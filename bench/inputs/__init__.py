"""Inputs of a result: files named by configs, files of plug-ins and programs, and the content hash of all of them.

In: specs and paths. Out: files and hashes. Imports only source-file analysis of trajectories, and from
scenes which files a model refers to.
"""
