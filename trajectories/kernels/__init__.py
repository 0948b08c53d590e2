"""Compiled kernels: the decorator, their argument types, where they are kept, and how they are compiled ahead.

In: functions. Out: machine code, the same on every run. Imports files and source files only.
"""
