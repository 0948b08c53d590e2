"""The history of a suite's scores over the commits of a repository: its file, trends, change points and page.

In: a history file that `uavbench gate --record` writes. Out: alarms, figures, a page, and the formats of two benchmark
services. Imports statistics, figures, style and the page's parts.
"""
