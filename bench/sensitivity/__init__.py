"""Sensitivity of a tracker to each number of its config: halved and doubled, one at a time.

In: a suite and one of its trackers. Out: a table of changes in success and error. Imports the runner and score files.
"""
