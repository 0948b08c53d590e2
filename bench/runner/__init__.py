"""The job graph: render, track, score, report; cached and resumable, on local workers or on a cluster.

In: a suite and a folder. Out: the folder, up to date. Imports config, inputs, external and third-party trackers, and
what each job runs.
"""
