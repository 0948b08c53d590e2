"""Constellation of navigation satellites, and their directions in the sky."""

import math

import numpy as np

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Array

EARTH_RADIUS_M = 6_371_000.0
"""Mean radius of the Earth (IUGG)."""
ORBIT_RADIUS_M = 26_560_000.0
INCLINATION_RAD = np.radians(55.0)
PLANES = 6
PER_PLANE = 4
ORBIT_PERIOD_S = 43_077.0
"""GPS: six planes of four, 55 degrees, half a sidereal day (GPS SPS performance standard 2020, section 3.2)."""
EARTH_RATE_RAD_S = 7.2921151467e-5
"""Angular velocity of the Earth (WGS 84)."""


def sky(times_s: Array, latitude_deg: float) -> Array:
    """Unit vectors (n, 24, 3), east north up, from a receiver on the ground to the satellites at times (n,).

    Planes are evenly spaced, as are the satellites within a plane; each plane is a quarter of a slot ahead of the last.
    """
    slot = np.arange(PLANES * PER_PLANE)
    plane = slot // PER_PLANE
    node = 2 * np.pi * plane / PLANES - EARTH_RATE_RAD_S * times_s[:, None]
    along = 2 * np.pi * ((slot % PER_PLANE + plane / 4) / PER_PLANE + times_s[:, None] / ORBIT_PERIOD_S)
    east_of_node, north_of_node = exact.cos(along), exact.sin(along)
    x, y = east_of_node, north_of_node * math.cos(INCLINATION_RAD)
    turn_cos, turn_sin = exact.cos(node), exact.sin(node)
    satellites = ORBIT_RADIUS_M * np.stack(
        [
            x * turn_cos - y * turn_sin,
            x * turn_sin + y * turn_cos,
            north_of_node * math.sin(INCLINATION_RAD),
        ],
        axis=-1,
    )
    latitude = math.radians(latitude_deg)
    up = np.array([math.cos(latitude), 0.0, math.sin(latitude)])
    north = np.array([-math.sin(latitude), 0.0, math.cos(latitude)])
    east = np.array([0.0, 1.0, 0.0])
    sight = satellites - EARTH_RADIUS_M * up
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    return exact.product(sight, np.array([east, north, up]).T)
