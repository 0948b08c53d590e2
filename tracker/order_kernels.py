"""Compiled sorts, shared by all kernels because sorts take long to compile."""

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


@compiled("i1! i1 | i1! f1", inner=True)
def sort_falling(rows: Indices, values: Array | Indices) -> None:
    """Sort rows (n,) in place by descending values; stable (merge sort)."""
    n = len(rows)
    merged = np.empty(n, np.int64)
    width = 1
    while width < n:
        for low in range(0, n, 2 * width):
            middle, high = min(low + width, n), min(low + 2 * width, n)
            i, j = low, middle
            for k in range(low, high):
                if i < middle and (j >= high or values[rows[i]] >= values[rows[j]]):
                    merged[k] = rows[i]
                    i += 1
                else:
                    merged[k] = rows[j]
                    j += 1
        for k in range(n):
            rows[k] = merged[k]
        width *= 2


@compiled("f1", inner=True)
def falling(values: Array) -> Indices:
    """Indices that sort values (n,) in descending order; stable."""
    rows = np.empty(len(values), np.int64)
    for k in range(len(values)):
        rows[k] = k
    sort_falling(rows, values)
    return rows
