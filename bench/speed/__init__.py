"""Benchmarks and what they are made of: `uavbench speed`.

In: the whole program. Out: times against goals. Imports every layer; nothing imports it but the command.
"""
