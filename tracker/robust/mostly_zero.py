"""Arrays of which little is written: what a run learns of the edges of a large structure, of which it sees few."""

import mmap

import numpy as np

from uavbench.trajectories.pose import Array

LARGE = 1 << 20
"""Bytes from which on an array gets pages of its own: mapping them takes 10 us."""


def mostly_zero(*shape: int) -> Array:
    """Zeros of a shape, which take memory in pages of 4 KiB where they are written.

    NumPy asks for pages of 2 MiB, each of which is cleared whole when a number in it is written: 0.1 ms, and a hundred
    of them for as many edges far from each other.
    """
    size = 8 * int(np.prod(shape))
    if size < LARGE or not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape)
    pages = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, dtype=np.float64).reshape(shape)
