"""Placement of clutter around a structure, clear of it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array

Free = Callable[[Array], NDArray[np.bool_]]
"""Predicate on places (n, 2): whether clutter may stand there, on level ground, not in water or on a road."""


def anywhere(places: Array) -> NDArray[np.bool_]:
    """All places are free."""
    return np.ones(len(places), dtype=bool)


def ring_places(
    bounds: Array, count: int, reach_m: tuple[float, float], rng: np.random.Generator, free: Free = anywhere
) -> Array:
    """Free places (count, 3) on the ground, outside the rectangle of the bounds by reach_m (least, most), by area."""
    nearest_m, furthest_m = reach_m
    low, high = bounds[0, :2], bounds[1, :2]
    out = np.zeros((count, 3))
    for k in range(count):
        while True:
            at = rng.uniform(low - furthest_m, high + furthest_m)
            gap = float(np.linalg.norm(np.maximum(np.maximum(low - at, at - high), 0)))
            if nearest_m <= gap <= furthest_m and free(at[None])[0]:
                break
        out[k, :2] = at
    return out
