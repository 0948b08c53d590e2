"""Bounding-volume hierarchy of axis-aligned boxes over the triangles of a mesh."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.geometry.bvh_kernels import split_triangles
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

MAX_DEPTH = 64
"""Size of the traversal stack; enough for 32 unbalanced levels and 2^30 triangles below them."""


class Tree(NamedTuple):
    """Tree: low, high (k, 3) boxes of the nodes; first, counts (k,) the triangles of a leaf (counts 0: inner);
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
    """Tree of triangles (m, 3, 3), m > 0, for rays and distances."""
    nodes = split_triangles(np.ascontiguousarray(corners, dtype=np.float64))
    low, high = (np.ascontiguousarray(nodes.boxes[:, side]) for side in range(2))
    ordered = np.ascontiguousarray(corners[nodes.order])
    return Tree(low, high, nodes.first, nodes.counts, nodes.child, ordered, nodes.order)
