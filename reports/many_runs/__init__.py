"""`uavbench evaluate` of many runs of several trackers against one ground truth.

In: estimates by tracker. Out: mean and spread, paired tests, tables, figures and a page. Imports the evaluation of two
trajectories, statistics, tables and the page's parts.
"""
