"""Scores of one tracker on one sequence, and the runs of a report.

In: a sequence and results. Out: score.json with a record of how it was computed. Imports metrics and protocols.
"""
