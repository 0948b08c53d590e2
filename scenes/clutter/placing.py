"""Placement of clutter around a structure, clear of it."""

import numpy as np

from uavbench.trajectories.pose import Array


def ring_places(bounds: Array, count: int, nearest_m: float, furthest_m: float, rng: np.random.Generator) -> Array:
    """Places (count, 3) on the ground, nearest_m to furthest_m outside the rectangle of the bounds, evenly by area."""
    low, high = bounds[0, :2], bounds[1, :2]
    out = np.zeros((count, 3))
    for k in range(count):
        while True:
            at = rng.uniform(low - furthest_m, high + furthest_m)
            gap = float(np.linalg.norm(np.maximum(np.maximum(low - at, at - high), 0)))
            if nearest_m <= gap <= furthest_m:
                break
        out[k, :2] = at
    return out
