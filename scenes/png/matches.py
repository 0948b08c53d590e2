"""Compiled search for stretches of bytes like those a distance before, 64 bytes at a time: one bit each in a word."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import BITS, bit_number, equal_bytes


@compiled("u1 (i0 i0) i0 w1! i1!", inner=True, allocates=False)
def find_matches(data: Any, part: Any, distance: int, masks: Any, places: Any) -> int:
    """List where the longest stretches of at least three bytes like those a distance before begin and end.

    places: begin and end, one after the other, from the start of the part (start, stop) of data; returns their number.
    masks: scratch of a word for each BITS bytes of the part, and one more.
    """
    start, stop = part
    words = -(-(stop - start) // BITS)
    for n in range(words):
        first = start + BITS * n
        if first >= distance and first + BITS <= stop:
            masks[n] = equal_bytes(data, np.uint64(first), np.uint64(first - distance))
        else:
            masks[n] = _some_equal(data, first, min(first + BITS, stop), distance)
    masks[words] = 0
    return _list_ends(masks, words, stop - start, places)


@compiled
def _some_equal(data: Any, begin: int, end: int, distance: int) -> Any:
    """The same of fewer bytes, or of those that have none a distance before them, which are like none."""
    word = np.uint64(0)
    for k in range(begin, end):
        if k >= distance and data[k] == data[k - distance]:
            word |= np.uint64(1) << np.uint64(k - begin)
    return word


@compiled
def _list_ends(masks: Any, words: int, size: int, places: Any) -> int:
    """List where stretches of at least three set bits begin and end; returns how many places these are."""
    count, before, last = 0, np.uint64(0), np.uint64(0)
    one, two = np.uint64(1), np.uint64(2)
    for n in range(words):
        here, after = masks[n], masks[n + 1]
        three = here & ((here >> one) | (after << np.uint64(63))) & ((here >> two) | (after << np.uint64(62)))
        within = three | (three << one) | (before >> np.uint64(63)) | (three << two) | (before >> np.uint64(62))
        ends = within ^ ((within << one) | last)
        before, last = three, within >> np.uint64(63)
        while ends != 0:
            single = ends & (~ends + one)
            places[count] = BITS * n + int(bit_number(single))
            count += 1
            ends ^= single
    if count % 2 == 1:
        places[count] = size
        count += 1
    return count
