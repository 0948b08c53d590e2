"""Figures: one module per family, all in one style.

In: runs and scores. Out: matplotlib figures with the numbers behind them. Imports scoring, metrics and statistics.
"""
