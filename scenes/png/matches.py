"""Compiled search for stretches of bytes like those a distance before, 64 bytes at a time: one bit each in a word."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

BITS = 64
"""Bits of a word."""
PACK = np.uint64(0x0102040810204080)
"""Factor that moves the lowest bit of each of eight bytes, the others 0, to the highest byte, in their order."""
SINGLE = np.uint64(0x03F79D71B4CB0A89)
"""Factor whose products with 2^0 .. 2^63 differ in their highest six bits (Leiserson, Prokop & Randall 1998)."""
PLACES = np.zeros(BITS, dtype=np.uint8)
"""Number of a single bit by those six bits."""
PLACES[[(int(SINGLE) << k & 2**BITS - 1) >> 58 for k in range(BITS)]] = np.arange(BITS)


@compiled("u1 (i0 i0) i0 u1! w1 w1! i1!", inner=True, allocates=False)
def find_matches(data: Any, part: Any, distance: int, same: Any, eights: Any, masks: Any, places: Any) -> int:
    """List where the longest stretches of at least three bytes like those a distance before begin and end.

    places: begin and end, one after the other, from the start of the part (start, stop) of data; returns their number.
    same, eights: scratch of whole words of BITS bytes for the part, and the same in 64-bit words; masks: scratch of a
    word for each BITS bytes, and one more.
    """
    start, stop = part
    size = stop - start
    words, first = -(-size // BITS), min(max(distance - start, 0), size)
    same[:first] = 0
    _compare(data[start + first : stop], data[start + first - distance : stop - distance], same[first:size])
    same[size : BITS * words] = 0
    for n in range(words):
        word = np.uint64(0)
        for k in range(8):
            word |= ((eights[8 * n + k] * PACK) >> np.uint64(56)) << np.uint64(8 * k)
        masks[n] = word
    masks[words] = 0
    return _list_ends(masks, words, size, places)


@compiled
def _compare(one: Any, other: Any, same: Any) -> None:
    """Whether bytes (n,) are the same."""
    for k in range(same.size):
        same[k] = np.uint8(one[k] == other[k])


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
            places[count] = BITS * n + int(PLACES[(single * SINGLE) >> np.uint64(58)])
            count += 1
            ends ^= single
    if count % 2 == 1:
        places[count] = size
        count += 1
    return count
