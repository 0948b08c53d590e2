"""Compiled search for stretches of bytes like those a distance before, 64 bytes at a time: one bit each in a word."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.equal_bytes import BITS, equal_bytes, lowest_bit, set_bits

AT_ONCE = 4
"""Places that are listed at once."""


@compiled("u1 (i0 i0) i0 w1! w1! i1!", inner=True, allocates=False)
def find_matches(data: Any, part: Any, distance: int, masks: Any, threes: Any, places: Any) -> int:
    """List where the longest stretches of at least three bytes like those a distance before begin and end.

    places: begin and end, one after the other, from the start of the part (start, stop) of data, with room for AT_ONCE
    more; returns their number. masks and threes: scratch of a word for each BITS bytes of the part, and one more.
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
    _mark_ends(masks, words, threes)
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
def _mark_ends(masks: Any, words: int, threes: Any) -> None:
    """Turn bits that are set into those of where stretches of at least three of them begin, and of those after them.

    threes (words + 1,): scratch, whose bits are set where such a stretch begins or goes on by three. Words do not wait
    for those before them, which becomes vectors.
    """
    one, two, top = np.uint64(1), np.uint64(2), np.uint64(BITS - 1)
    threes[0] = 0
    for n in range(words):
        here, after = masks[n], masks[n + 1]
        threes[n + 1] = here & ((here >> one) | (after << top)) & ((here >> two) | (after << (top - one)))
    for n in range(words):
        before, here = threes[n], threes[n + 1]
        within = here | (here << one) | (here << two) | (before >> top) | (before >> (top - one))
        masks[n] = within ^ ((within << one) | np.uint64((before >> (top - two)) != 0))


@compiled
def _list_ends(masks: Any, words: int, size: int, places: Any) -> int:
    """List the places of the bits of words, and the size if they are odd in number; returns how many places these are.

    AT_ONCE at once, some of which are overwritten: how many a word has is hard to predict.
    """
    count = 0
    for n in range(words):
        ends = masks[n]
        beyond = count + int(set_bits(ends))
        while count < beyond:
            for k in range(AT_ONCE):
                places[count + k] = BITS * n + int(lowest_bit(ends))
                ends &= ends - np.uint64(1)
            count += AT_ONCE
        count = beyond
    if count % 2 == 1:
        places[count] = size
        count += 1
    return count
