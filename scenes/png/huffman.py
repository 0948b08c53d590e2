"""Compiled length-limited Huffman codes (RFC 1951, section 3.2)."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

DEEPEST = 64
"""Bound of the depth of the tree: a code of 64 bits takes more than 2^44 occurrences (Fibonacci counts)."""


@compiled("i1 i0 i1!", inner=True)
def code_lengths(counts: Any, longest: int, lengths: Any) -> None:
    """Code length (n,) in bits of each symbol from its count (n,): 0 where it does not occur, at most longest.

    At least two symbols must occur. Huffman's algorithm with a queue of leaves and one of inner nodes (van Leeuwen
    1976); codes above longest are truncated, and shorter ones lengthened until the Kraft sum is 1.
    """
    size = counts.size
    order = np.empty(size, dtype=np.int64)
    n = 0
    for symbol in range(size):
        if counts[symbol] > 0:
            order[n] = counts[symbol] * size + symbol
            n += 1
    order = np.sort(order[:n])
    weights, parents = np.empty(2 * n - 1, dtype=np.int64), np.empty(2 * n - 1, dtype=np.int64)
    weights[:n] = order // size
    leaf, inner = 0, n
    for node in range(n, 2 * n - 1):
        weights[node] = 0
        for _ in range(2):
            if leaf < n and (inner == node or weights[leaf] <= weights[inner]):
                taken = leaf
                leaf += 1
            else:
                taken = inner
                inner += 1
            weights[node] += weights[taken]
            parents[taken] = node
    per_depth = np.zeros(DEEPEST, dtype=np.int64)
    depths = weights
    depths[2 * n - 2] = 0
    for node in range(2 * n - 3, -1, -1):
        depths[node] = depths[parents[node]] + 1
        if node < n:
            per_depth[min(depths[node], longest)] += 1
    _limit(per_depth, longest)
    lengths[:] = 0
    k = n
    for depth in range(1, longest + 1):
        for _ in range(per_depth[depth]):
            k -= 1
            lengths[order[k] % size] = depth


@compiled
def _limit(per_depth: Any, longest: int) -> None:
    """Lengthen codes, deepest first, until the counts per code length satisfy the Kraft inequality."""
    excess = -(1 << longest)
    for depth in range(1, longest + 1):
        excess += per_depth[depth] << (longest - depth)
    while excess > 0:
        per_depth[longest] -= 1
        depth = longest - 1
        while per_depth[depth] == 0:
            depth -= 1
        per_depth[depth] -= 1
        per_depth[depth + 1] += 2
        excess -= 1


@compiled("i1 w1!", inner=True)
def codes(lengths: Any, out: Any) -> None:
    """Canonical codes (section 3.2.2) of code lengths (n,), bit-reversed, as they are written to the stream."""
    per_depth, code = np.zeros(DEEPEST, dtype=np.int64), np.zeros(DEEPEST, dtype=np.int64)
    for symbol in range(lengths.size):
        per_depth[lengths[symbol]] += 1
    per_depth[0] = 0
    for depth in range(1, DEEPEST):
        code[depth] = 2 * (code[depth - 1] + per_depth[depth - 1])
    for symbol in range(lengths.size):
        depth = lengths[symbol]
        turned = 0
        for bit in range(depth):
            turned |= ((code[depth] >> bit) & 1) << (depth - 1 - bit)
        out[symbol] = np.uint64(turned)
        code[depth] += 1
