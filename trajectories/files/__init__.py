"""Reading and writing of files.

In: paths. Out: content within named limits; files and folders that appear atomically and never replace what uavbench
did not write. Imports errors only.
"""
