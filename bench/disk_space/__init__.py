"""Disk space of what is not written yet: bytes of a sequence and of its images by the spec, as `--dry-run` tells.

In: a sequence's spec, frames, seconds. Out: bytes. Imports specs, structures, effects and sensors; nothing of the
runner.
"""
