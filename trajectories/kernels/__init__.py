"""Compiled kernels: the decorator, argument types, the cache on disk, and compilation ahead of use.

In: functions. Out: machine code with bit-identical results on every run. Imports files and source files only.
"""
