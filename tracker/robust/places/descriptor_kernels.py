"""Compiled comparison of descriptors: strings of bits that differ in few places where two features look alike."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled, inlined

Indices = NDArray[np.int64]
Words = NDArray[np.uint64]
WORDS = 4
"""Words of 64 bits of a descriptor (Rublee et al. 2011)."""
PAIRS, FOURS, EIGHTS = 0x5555555555555555, 0x3333333333333333, 0x0F0F0F0F0F0F0F0F
"""Every second bit, every second pair of bits, and every second four of them, of a word of 64 bits."""
HALVES, ALL_HALVES, TOP = 0x00FF00FF00FF00FF, 0x0001000100010001, 48
"""Every second byte; the factor that adds four numbers of 16 bits in the topmost one; where that begins."""


class NearestTwo(NamedTuple):
    """The number of different bits (n,) of the most similar other descriptor and of the second one; the row (n,) of
    the first.
    """

    first: Indices
    second: Indices
    row: Indices


@inlined
def eights(word: Any) -> Any:
    """The number of bits in each byte of a word, as eight numbers of 8 bits."""
    twos = word - ((word >> np.uint64(1)) & np.uint64(PAIRS))
    fours = (twos & np.uint64(FOURS)) + ((twos >> np.uint64(2)) & np.uint64(FOURS))
    return (fours + (fours >> np.uint64(4))) & np.uint64(EIGHTS)


@compiled("w2~ w2")
def nearest_two(words: Words, others: Words) -> NearestTwo:
    """The two of the other descriptors (WORDS, m), a column each, nearest to each of the descriptors (n, WORDS).

    m is at least 2.
    """
    n, m = len(words), others.shape[1]
    first, second, row = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    different = np.empty(m, np.int64)
    for i in range(n):
        a, b, c, d = words[i, 0], words[i, 1], words[i, 2], words[i, 3]
        for j in range(m):
            left = eights(a ^ others[0, j]) + eights(b ^ others[1, j])
            bits = left + eights(c ^ others[2, j]) + eights(d ^ others[3, j])
            halves = (bits & np.uint64(HALVES)) + ((bits >> np.uint64(8)) & np.uint64(HALVES))
            different[j] = np.int64((halves * np.uint64(ALL_HALVES)) >> np.uint64(TOP))
        best, next_best, at = np.int64(64 * WORDS + 1), np.int64(64 * WORDS + 1), 0
        for j in range(m):
            if different[j] < best:
                best, next_best, at = different[j], best, j
            elif different[j] < next_best:
                next_best = different[j]
        first[i], second[i], row[i] = best, next_best, at
    return NearestTwo(first, second, row)
