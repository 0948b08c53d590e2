"""The command `uavbench`: short commands over files.

In: words of a command line. Out: an exit code and messages for people. Imports every other room of bench.
"""
