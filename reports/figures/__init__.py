"""Figures: one file a family, each drawn from runs in one look.

In: runs and scores. Out: matplotlib figures with the numbers behind them. Imports scoring, metrics and statistics.
"""
