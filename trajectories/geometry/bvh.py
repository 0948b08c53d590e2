"""Bounding-volume hierarchy of axis-aligned boxes over the triangles of a mesh."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

LEAF = 4
"""Triangles in a leaf of the tree."""
MAX_DEPTH = 64
"""Size of the traversal stack; enough for a balanced tree of 2^60 leaves."""


class Tree(NamedTuple):
    """Balanced tree: low, high (k, 3) boxes of the nodes; first, counts (k,) the triangles of a leaf (counts 0: inner);
    child (k,) the first of two consecutive children; corners (m, 3, 3) triangles in leaf order, and rows (m,) their
    original indices.
    """

    low: Array
    high: Array
    first: NDArray[np.int64]
    counts: NDArray[np.int64]
    child: NDArray[np.int64]
    corners: Array
    rows: NDArray[np.int64]


TREE = named_tuple(Tree, "f2! f2! i1! i1! i1! f3! i1!")


def build_tree(corners: Array) -> Tree:
    """Tree of triangles (m, 3, 3), split at the median along the longest side of each box."""
    middle = corners.mean(axis=1)
    order = np.arange(len(corners))
    boxes: list[tuple[Array, Array]] = []
    first, count, child = [0], [0], [0]
    spans = [(0, len(corners))]
    node = 0
    while node < len(spans):
        begin, end = spans[node]
        rows = order[begin:end]
        low, high = corners[rows].min(axis=(0, 1)), corners[rows].max(axis=(0, 1))
        boxes.append((low, high))
        if end - begin <= LEAF:
            first[node], count[node] = begin, end - begin
        else:
            axis = int(np.argmax(high - low))
            order[begin:end] = rows[np.argsort(middle[rows, axis], kind="stable")]
            half = (begin + end) // 2
            child[node] = len(spans)
            for span in ((begin, half), (half, end)):
                spans.append(span)
                first.append(0)
                count.append(0)
                child.append(0)
        node += 1
    low, high = (np.ascontiguousarray([box[k] for box in boxes]) for k in range(2))
    leaves = np.array(first), np.array(count), np.array(child)
    return Tree(low, high, *leaves, np.ascontiguousarray(corners[order]), order)
