"""Uncertainty of scores over sequences and seeds, and whether one tracker beats another.

In: scores by sequence and seed. Out: intervals and p-values. Imports no other package of reports.
"""
