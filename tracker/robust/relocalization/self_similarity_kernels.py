"""Compiled lookup of the cells of space that edges pass through, and the fraction of points that a shift maps there."""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

FACTOR = np.int64(1_000_003)
"""A prime; keys of different cells and directions collide with a probability of about 1e-13."""
MIXED = np.int64(0x1E3779B97F4A7C15)
"""Odd factor whose product spreads keys evenly over its upper bits (Knuth 1973, 6.4: multiplicative hashing)."""
MIXED_BITS = 32
"""Number of lower bits of the product that are dropped."""
NONE = np.int64(-(2**63))
"""Place of a table that is empty."""
ROOM = 4
"""Least number of places of a table for each key: few are then looked up to find one."""

Indices = NDArray[np.int64]


@compiled("f0 f0 f0 i0 f0", inner=True)
def key_of(x: float, y: float, z: float, direction: int, cell: float) -> int:
    """Key of the cell of a point and of a direction."""
    key = np.int64(math.floor(x / cell)) * FACTOR + np.int64(math.floor(y / cell))
    return int((key * FACTOR + np.int64(math.floor(z / cell))) * FACTOR + direction)


@compiled("i0 i1!", inner=True)
def place_of(key: int, table: Indices) -> int:
    """Place of a key in a table, or the empty one where it would be (linear probing)."""
    last = len(table) - 1
    place = ((key * MIXED) >> MIXED_BITS) & last
    while table[place] != NONE and table[place] != key:
        place = (place + 1) & last
    return int(place)


@compiled("i1!", inner=True)
def table_of(keys: Indices) -> Indices:
    """Table of keys (n,), of which some may be equal; its length is a power of two."""
    size = 1
    while size < ROOM * len(keys) + 1:
        size *= 2
    table = np.full(size, NONE)
    for key in keys:
        table[place_of(key, table)] = key
    return table


@compiled("f2 i1 f0")
def table_of_cells(points: Array, directions: Indices, cell: float) -> Indices:
    """Table of the keys of the cells of points (n, 3) on edges of numbered directions (n,)."""
    keys = np.empty(len(points), np.int64)
    for n in range(len(points)):
        keys[n] = key_of(points[n, 0], points[n, 1], points[n, 2], directions[n], cell)
    table = table_of(keys)
    return table_of(table[table != NONE])  # smaller, since many points share a cell


@compiled("f2 i1 f0 i1!")
def on_edges(points: Array, directions: Indices, cell: float, table: Indices) -> NDArray[np.bool_]:
    """Mask (n,) of the points (n, 3) in a cell with an edge of their direction."""
    out = np.empty(len(points), np.bool_)
    for n in range(len(points)):
        key = key_of(points[n, 0], points[n, 1], points[n, 2], directions[n], cell)
        out[n] = table[place_of(key, table)] == key
    return out


@compiled("f2 f2 i1 f0 i1!")
def shares_on_edges(shifts: Array, points: Array, directions: Indices, cell: float, table: Indices) -> Array:
    """Fraction (k,) of points (n, 3) that each shift (k, 3) maps into a cell with an edge of their direction."""
    out = np.zeros(len(shifts))
    for k in range(len(shifts)):
        for n in range(len(points)):
            x, y, z = points[n, 0] + shifts[k, 0], points[n, 1] + shifts[k, 1], points[n, 2] + shifts[k, 2]
            key = key_of(x, y, z, directions[n], cell)
            if table[place_of(key, table)] == key:
                out[k] += 1.0 / len(points)
    return out
