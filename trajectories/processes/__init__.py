"""Programs that end with us and within their limits, and readers that run as such programs.

In: a command, or a reader's module and an untrusted file. Out: exit codes, and what they wrote into a temporary folder.
Imports the file guards.
"""
