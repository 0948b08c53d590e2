"""Meshes that tests fly around, and a flight that stands still."""

import numpy as np

from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> ObstacleMesh:
    """A closed block between two corners."""
    return ObstacleMesh(np.array(low) + CORNERS * (np.array(high) - np.array(low)), FACES)


def both(a: ObstacleMesh, b: ObstacleMesh) -> ObstacleMesh:
    """Two meshes as one."""
    return ObstacleMesh(
        np.concatenate([a.vertices, b.vertices]), np.concatenate([a.triangles, b.triangles + len(a.vertices)])
    )


def standing(seconds: float, height: float = 1.0, step_ns: int = STEP_NS) -> Flight:
    """A vehicle that stands in the air."""
    n = round(seconds * 1e9 / step_ns) + 1
    zeros = np.zeros((n, 3))
    return Flight(
        np.arange(n) * step_ns,
        zeros + np.array([5.0, 0.0, height]),
        np.tile([1.0, 0, 0, 0], (n, 1)),
        *[zeros] * 4,
        *[np.zeros((n, 4))] * 2,
        zeros,
    )


BOX = block((-0.2, -0.15, 0.0), (0.2, 0.15, 0.3))
WALL = block((-0.25, -4.0, 0.0), (0.25, 4.0, 5.0))
DECK = block((-6.0, -5.0, 5.0), (6.0, 5.0, 5.6))
PIER = block((-0.6, -0.6, 0.0), (0.6, 0.6, 8.0))
