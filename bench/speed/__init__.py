"""Benchmarks and what they are made of: `uavbench speed`."""
