"""Programs that end with us and within their limits, readers that run as such programs, and our standard streams.

In: a command, or a reader's module and an untrusted file. Out: exit codes, and what they wrote into a temporary folder;
streams that can be written to.
Imports the file guards.
"""
