"""Compiled lookup of the cells of space that edges pass through, and the fraction of points that a shift maps there."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

FACTOR = np.int64(1_000_003)
"""A prime; keys of different cells and directions collide with a probability of about 1e-13."""


@compiled
def _key(x: float, y: float, z: float, direction: np.int64, cell: float) -> np.int64:
    """Key of the cell of a point and of a direction."""
    key = np.int64(np.floor(x / cell)) * FACTOR + np.int64(np.floor(y / cell))
    return (key * FACTOR + np.int64(np.floor(z / cell))) * FACTOR + direction


@compiled("f2 i1 f0")
def cell_keys(points: Any, directions: Any, cell: float) -> Any:
    """Keys (n,) of points (n, 3) on edges of numbered directions (n,)."""
    out = np.empty(len(points), np.int64)
    for n in range(len(points)):
        out[n] = _key(points[n, 0], points[n, 1], points[n, 2], directions[n], cell)
    return out


@compiled("f2 f2 i1 f0 i1")
def shares_on_edges(shifts: Any, points: Any, directions: Any, cell: float, passed: Any) -> Any:
    """Fraction (k,) of points (n, 3) that each shift (k, 3) maps into a cell with an edge of their direction.

    passed (m,): sorted keys of those cells.
    """
    out = np.zeros(len(shifts))
    for k in range(len(shifts)):
        for n in range(len(points)):
            x, y, z = points[n, 0] + shifts[k, 0], points[n, 1] + shifts[k, 1], points[n, 2] + shifts[k, 2]
            key = _key(x, y, z, directions[n], cell)
            low, high = 0, len(passed)
            while low < high:
                middle = (low + high) // 2
                if passed[middle] < key:
                    low = middle + 1
                else:
                    high = middle
            if low < len(passed) and passed[low] == key:
                out[k] += 1.0 / len(points)
    return out
