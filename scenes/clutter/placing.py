"""Placement of clutter around a structure, without contact."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

Free = Callable[[Array], NDArray[np.bool_]]
"""Predicate on positions (n, 2) in the world, metres: level ground, neither in water nor on a road."""
MOST_TRIES = 100_000
"""Positions drawn for one object before there is held to be no room for it: about a second."""


def anywhere(places: Array) -> NDArray[np.bool_]:
    """Predicate that accepts all positions."""
    return np.ones(len(places), dtype=bool)


def check_reach(nearest_m: float, furthest_m: float) -> None:
    """UserError for distances between which there is no ring, metres."""
    if nearest_m >= furthest_m:
        raise UserError(
            f"nearest_m {nearest_m:g} is not below furthest_m {furthest_m:g}; lower nearest_m, or raise furthest_m"
        )


def ring_places(
    bounds: Array, count: int, reach_m: tuple[float, float], rng: np.random.Generator, free: Free = anywhere
) -> Array:
    """Positions (count, 3) on the ground, uniform over the area at reach_m (least, most) from the bounds' rectangle.

    bounds (2, 3) and positions are in the world frame, metres, with z = 0. Rejection sampling: positions that are not
    free are redrawn, MOST_TRIES times at most. UserError when there is no room.
    """
    nearest_m, furthest_m = reach_m
    low, high = bounds[0, :2], bounds[1, :2]
    out = np.zeros((count, 3))
    for k in range(count):
        for _ in range(MOST_TRIES):
            at = rng.uniform(low - furthest_m, high + furthest_m)
            if nearest_m <= gap_m(bounds, at) <= furthest_m and free(at[None])[0]:
                break
        else:
            raise UserError(
                f"no room for object {k + 1} of {count}: of {MOST_TRIES:,} positions drawn, none is free ground "
                f"{nearest_m:g} to {furthest_m:g} m from the structure; raise furthest_m, or lower nearest_m"
            )
        out[k, :2] = at
    return out


def gap_m(bounds: Array, at: Array) -> float:
    """Distance in metres on the ground from a position (2,) or (3,) to the rectangle of bounds (2, 3)."""
    low, high = bounds[0, :2], bounds[1, :2]
    return float(np.linalg.norm(np.maximum(np.maximum(low - at[:2], at[:2] - high), 0)))
