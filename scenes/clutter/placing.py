"""Placement of clutter around a structure, without contact."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

Free = Callable[[Array], NDArray[np.bool_]]
"""Predicate on positions (n, 2) in the world, metres: level ground, neither in water nor on a road."""
MOST_TRIES = 100_000
"""Positions drawn for one object before there is held to be no room for it."""
MOST_AT_ONCE = 4096
"""Of them, those that are drawn at once."""
ROUNDING_M = 1e-9
"""Distance to the border of the ring within which the gap of each position is computed by itself, as one alone is."""


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
    out = np.zeros((count, 3))
    for k in range(count):
        place = _place(bounds, reach_m, rng, free)
        if place is None:
            raise UserError(
                f"no room for object {k + 1} of {count}: of {MOST_TRIES:,} positions drawn, none is free ground "
                f"{reach_m[0]:g} to {reach_m[1]:g} m from the structure; raise furthest_m, or lower nearest_m"
            )
        out[k, :2] = place
    return out


def _place(bounds: Array, reach_m: tuple[float, float], rng: np.random.Generator, free: Free) -> Array | None:
    """First free position (2,) of those drawn, None where there is none; the generator has then drawn no further.

    Many are drawn at once where few are free, which takes a tenth of the time.
    """
    nearest_m, furthest_m = reach_m
    low, high = bounds[0, :2] - furthest_m, bounds[1, :2] + furthest_m
    tried, number = 0, 1
    while tried < MOST_TRIES:
        before, number = rng.bit_generator.state, min(number, MOST_TRIES - tried)
        drawn = rng.uniform(low, high, (number, 2))
        off_m = np.linalg.norm(np.maximum(np.maximum(bounds[0, :2] - drawn, drawn - bounds[1, :2]), 0), axis=1)
        inside_m = np.minimum(off_m - nearest_m, furthest_m - off_m)
        for i in np.flatnonzero(inside_m > -ROUNDING_M):
            at = drawn[i]
            if (inside_m[i] > ROUNDING_M or nearest_m <= gap_m(bounds, at) <= furthest_m) and free(at[None])[0]:
                rng.bit_generator.state = before
                rng.uniform(low, high, (i + 1, 2))
                return np.asarray(at)
        tried, number = tried + number, min(8 * number, MOST_AT_ONCE)
    return None


def gap_m(bounds: Array, at: Array) -> float:
    """Distance in metres on the ground from a position (2,) or (3,) to the rectangle of bounds (2, 3)."""
    low, high = bounds[0, :2], bounds[1, :2]
    return float(np.linalg.norm(np.maximum(np.maximum(low - at[:2], at[:2] - high), 0)))
