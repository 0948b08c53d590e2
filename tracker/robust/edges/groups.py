"""Groups of neighbouring edges, each in a sphere: those that no image shows are passed over at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.pose import Array

GROUP = 32
"""Edges of a group: a sphere is tested in a quarter of the time of an edge."""
STEPS = 1024
"""Parts of the largest extent of a structure by which places are ordered."""

Indices = NDArray[np.int64]


class Groups(NamedTuple):
    """Edges in an order (e,) in which each GROUP of them is together; spheres (g, 4) about these: centre, radius."""

    order: Indices
    spheres: Array

    @classmethod
    def of(cls, ends: Array) -> "Groups":
        """Groups of edges (e, 2, 3): of about one length, and along a curve that fills space (Morton 1966)."""
        if not len(ends):
            return cls(np.zeros(0, dtype=np.int64), np.zeros((0, 4)))
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        size = np.round(np.log2(np.maximum(length, length.max(initial=1e-12) / STEPS))).astype(np.int64)
        low, middle = ends.min(axis=(0, 1)), ends.mean(axis=1)
        extent = max(float(np.ptp(ends, axis=(0, 1)).max()), 1e-12)
        order = np.lexsort([interleaved(np.floor((middle - low) * ((STEPS - 1) / extent)).astype(np.int64)), size])
        first = np.arange(0, len(ends), GROUP)
        corners = ends[order].reshape(-1, 3)
        lowest, highest = (bound.reduceat(corners, 2 * first, axis=0) for bound in (np.minimum, np.maximum))
        centres = 0.5 * (lowest + highest)
        away = np.linalg.norm(corners - np.repeat(centres, np.diff([*first, len(ends)]) * 2, axis=0), axis=1)
        return cls(order, np.column_stack([centres, np.maximum.reduceat(away, 2 * first)]))


GROUPS = named_tuple(Groups, "i1! f2!")


def interleaved(cells: Indices) -> Indices:
    """Numbers (n,) whose bits are in turn those of the three columns of cells (n, 3), each below STEPS."""
    found = np.zeros(len(cells), dtype=np.int64)
    for bit in range(STEPS.bit_length() - 1):
        for column in range(3):
            found |= ((cells[:, column] >> bit) & 1) << (3 * bit + column)
    return found
