"""What a result was made of: source files, what they import and name, and digests of their content.

In: names of modules, and paths. Out: files and digests. Imports nothing else of uavbench.
"""
