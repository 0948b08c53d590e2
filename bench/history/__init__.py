"""Scores along the commits of a git repository: recording them, and finding the commit that made one worse.

In: a folder of scores, or two commits. Out: a line in a history file, or the first worse commit. Imports the gate, its
versions and comparison, and the history file of reports.
"""
