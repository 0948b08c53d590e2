"""Leaderboards: what the submissions to a challenge have scored, and a page that ranks them.

In: scores of submissions. Out: a folder with a page and tables. Imports statistics, tables, page and style.
"""
