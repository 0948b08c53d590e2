"""Compiled kernels: the decorator, argument types, the cache on disk, and compilation ahead of use.

In: functions. Out: machine code that gives the same bits on every run. Imports files and source files only.
"""
