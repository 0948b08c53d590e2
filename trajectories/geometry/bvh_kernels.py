"""Compiled construction of a bounding-volume hierarchy by the surface area heuristic.

The cost of a split is the sum over both children of the surface of their box, which is in proportion to the rays that
enter it, times their number of triangles (MacDonald & Booth 1990); splits are tried at the borders of a few bins along
each axis (Wald 2007).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

LEAF = 4
"""Most triangles in a leaf of the tree."""
BINS = 16
"""Parts of the extent of a node along an axis, at whose borders it may be split."""
BALANCED = 32
"""Depth from which nodes are halved: an unbalanced tree could outgrow the traversal's stack of 64 nodes."""

Indices = NDArray[np.int64]


class Nodes(NamedTuple):
    """Nodes of a tree: boxes (k, 2, 3); first, counts (k,) the triangles of a leaf (counts 0: inner); child (k,) the
    first of two consecutive children; order (m,) the triangles of the leaves.
    """

    boxes: Array
    first: Indices
    counts: Indices
    child: Indices
    order: Indices


class Split(NamedTuple):
    """Axis of a split, the place of its first bin and the bins per metre along it, the last bin of the first child,
    and its cost in units of triangles times the surface of the node; a cost of inf for none.
    """

    axis: int
    low: float
    bins_1_m: float
    last: int
    cost: float


@compiled
def half_surface(box: Array) -> float:
    """Half of the surface of a box (2, 3), 0 for an empty one."""
    x, y, z = box[1, 0] - box[0, 0], box[1, 1] - box[0, 1], box[1, 2] - box[0, 2]
    return x * y + y * z + z * x if x >= 0.0 and y >= 0.0 and z >= 0.0 else 0.0


@compiled
def extend(box: Array, other: Array) -> None:
    """Extend a box (2, 3) in place, so that it holds another."""
    for k in range(3):
        box[0, k] = min(box[0, k], other[0, k])
        box[1, k] = max(box[1, k], other[1, k])


@compiled
def clear(boxes: Array) -> None:
    """Make boxes (..., 2, 3) empty."""
    boxes[..., 0, :] = np.inf
    boxes[..., 1, :] = -np.inf


@compiled
def bin_of(place: float, low: float, bins_1_m: float) -> int:
    """Bin in which a place lies; clamped, since rounding and NaN lead out of range."""
    return max(0, min(BINS - 1, int((place - low) * bins_1_m)))


@compiled
def best_split(boxes: Array, middle: Array, rows: Indices) -> Split:
    """The split of least cost of the triangles `rows`, with the boxes (m, 2, 3) and middles (m, 3) of all."""
    best = Split(0, 0.0, 0.0, 0, np.inf)
    binned, left, right = np.empty((BINS, 2, 3)), np.empty((2, 3)), np.empty((2, 3))
    number, cost = np.empty(BINS, np.int64), np.empty(BINS)
    for axis in range(3):
        low, high = np.inf, -np.inf
        for row in rows:
            low, high = min(low, middle[row, axis]), max(high, middle[row, axis])
        if not high > low:
            continue
        bins_1_m = BINS / (high - low)
        clear(binned)
        number[:] = 0
        for row in rows:
            k = bin_of(middle[row, axis], low, bins_1_m)
            number[k] += 1
            extend(binned[k], boxes[row])
        clear(right)
        above = 0
        for k in range(BINS - 1, 0, -1):
            above += number[k]
            extend(right, binned[k])
            cost[k - 1] = above * half_surface(right) if above else np.inf
        clear(left)
        below = 0
        for k in range(BINS - 1):
            below += number[k]
            extend(left, binned[k])
            total = below * half_surface(left) + cost[k]
            if below and total < best.cost:
                best = Split(axis, low, bins_1_m, k, total)
    return best


@compiled
def parted(middle: Array, rows: Indices, split: Split) -> int:
    """Number of triangles in the first child of a split; `rows` are reordered in place, otherwise in their order."""
    later = np.empty(len(rows), np.int64)
    n = m = 0
    for row in rows:
        if bin_of(middle[row, split.axis], split.low, split.bins_1_m) <= split.last:
            rows[n] = row
            n += 1
        else:
            later[m] = row
            m += 1
    rows[n:] = later[:m]
    return n


@compiled("f3")
def split_triangles(corners: Array) -> Nodes:
    """Nodes of a tree of triangles (m, 3, 3), m > 0."""
    n = len(corners)
    own, middle = np.empty((n, 2, 3)), np.empty((n, 3))
    for t in range(n):
        for k in range(3):
            a, b, c = corners[t, 0, k], corners[t, 1, k], corners[t, 2, k]
            own[t, 0, k], own[t, 1, k] = min(a, b, c), max(a, b, c)
            middle[t, k] = 0.5 * (own[t, 0, k] + own[t, 1, k])
    boxes = np.empty((2 * n, 2, 3))
    begin, end, depth = np.empty(2 * n, np.int64), np.empty(2 * n, np.int64), np.empty(2 * n, np.int64)
    first, counts, child = np.zeros(2 * n, np.int64), np.zeros(2 * n, np.int64), np.zeros(2 * n, np.int64)
    order = np.arange(n)
    begin[0], end[0], depth[0] = 0, n, 0
    nodes, node = 1, 0
    clear(boxes)
    while node < nodes:
        rows = order[begin[node] : end[node]]
        for row in rows:
            extend(boxes[node], own[row])
        split = best_split(own, middle, rows)
        surface = half_surface(boxes[node])
        # Entering a node costs about as much as one triangle.
        if len(rows) == 1 or (len(rows) <= LEAF and not split.cost + surface < len(rows) * surface):
            first[node], counts[node] = begin[node], len(rows)
        else:
            halved = depth[node] >= BALANCED or split.cost == np.inf
            middle_of_rows = begin[node] + (len(rows) // 2 if halved else parted(middle, rows, split))
            child[node] = nodes
            begin[nodes], end[nodes], depth[nodes] = begin[node], middle_of_rows, depth[node] + 1
            begin[nodes + 1], end[nodes + 1], depth[nodes + 1] = middle_of_rows, end[node], depth[node] + 1
            nodes += 2
        node += 1
    return Nodes(boxes[:nodes].copy(), first[:nodes].copy(), counts[:nodes].copy(), child[:nodes].copy(), order)
