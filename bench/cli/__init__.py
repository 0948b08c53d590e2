"""The command `uavbench`: subcommands that read and write files.

In: command-line arguments. Out: an exit code and messages for people. Imports every other room of bench.
"""
