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
FIRST_SIZE = 1024
"""Places of a table that grows."""
CELLS = 8
"""Most cells of a point: as many as a cube has corners."""

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


@compiled("i1! i0", inner=True)
def table_of(keys: Indices, room: int) -> Indices:
    """Table of keys (n,) with so many places for each at least; its length is a power of two."""
    size = 1
    while size < room * len(keys) + 1:
        size *= 2
    table = np.full(size, NONE)
    for key in keys:
        table[place_of(key, table)] = key
    return table


@compiled("f3! i1! i1! f0")
def table_of_edges(ends: Array, counts: Indices, directions: Indices, cell: float) -> Indices:
    """Table of the keys of the cells of edges (e, 2, 3) of numbered directions (e,), by counts (e,) points on each.

    The cells of a point are those that hold all points up to half a cell away.
    """
    table, filled, half = np.full(FIRST_SIZE, NONE), 0, 0.5 * cell
    for e in range(len(ends)):
        for k in range(counts[e]):
            part = k / (counts[e] - 1)
            x = ends[e, 0, 0] + part * (ends[e, 1, 0] - ends[e, 0, 0])
            y = ends[e, 0, 1] + part * (ends[e, 1, 1] - ends[e, 0, 1])
            z = ends[e, 0, 2] + part * (ends[e, 1, 2] - ends[e, 0, 2])
            for i in (-half, half):
                for j in (-half, half):
                    for m in (-half, half):
                        key = key_of(x + i, y + j, z + m, directions[e], cell)
                        place = place_of(key, table)
                        filled += int(table[place] == NONE)
                        table[place] = key
            if ROOM * (filled + CELLS) > len(table):
                table = table_of(table[table != NONE], 2 * ROOM)
    return table_of(table[table != NONE], ROOM)


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
