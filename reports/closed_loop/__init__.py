"""Flights in closed loop: their files, measures, and the table over many.

In: a folder that `uavbench.bench.closed_loop` wrote. Out: scores, tables and figures. Imports metrics, statistics,
tables and figures of this package, and the tracker's results.
"""
