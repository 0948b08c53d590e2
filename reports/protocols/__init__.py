"""Protocols other than the free run: reset on failure, anchored restarts, real-time replay.

In: a tracker and a sequence. Out: results and failures. Imports metrics.
"""
