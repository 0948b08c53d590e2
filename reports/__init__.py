"""Scores and reports: association, alignment, metrics, statistics, tables, figures and the HTML page.

Packages: metrics and statistics compute; scoring, protocols and uncertainty judge a run; evaluation and many_runs
compare trajectory files; tables, figures and page show it. Imports tracker, scenes and trajectories.
"""
