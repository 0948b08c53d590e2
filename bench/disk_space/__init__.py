"""Disk space of what is not written yet: bytes of a sequence by its spec, as `--dry-run` tells.

In: a sequence's spec, frames, seconds. Out: bytes. Imports specs, structures, effects and sensors; nothing of the
runner.
"""
