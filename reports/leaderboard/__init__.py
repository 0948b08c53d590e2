"""Leaderboards: the scores of the submissions to a challenge, and a page that ranks them.

In: scores of submissions. Out: a folder with a page and tables. Imports statistics, tables, page and style.
"""
