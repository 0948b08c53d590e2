"""Scores: one tracker on one sequence, and the runs that a report is about.

In: a sequence and results. Out: score.json with a record of how it was computed. Imports metrics and protocols.
"""
