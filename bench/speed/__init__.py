"""Benchmarks of computing time and their inputs: `uavbench speed`.

In: the whole program. Out: times against goals. Imports every layer; only the command imports it.
"""
