"""The job graph: render, track, score, report; cached, resumed, in workers here or on a cluster.

In: a suite and a folder. Out: the folder brought up to date. Imports config, inputs, external and third-party
trackers, and what each job runs.
"""
