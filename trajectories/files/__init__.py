"""How any file is read and written.

In: paths. Out: content within named limits, and files and folders that appear whole or not at all and replace nothing
but our own. Imports errors only.
"""
