"""Prediction: where the camera will be at the next frame, and how sure that is."""

from dataclasses import dataclass

import numpy as np

from uavbench.tracker.geometry_kernels import move, twist_between
from uavbench.trajectories.pose import Array, Pose

MEMORY_S = 1.0
"""Time over which a velocity is forgotten (first-order Gauss-Markov motion)."""
ACCELERATION_M_S2 = 4.0
"""One standard deviation of the acceleration of a small multirotor that is flown by hand."""
ANGULAR_ACCELERATION_RAD_S2 = 10.0
"""The same of its angular acceleration."""
FIRST_SPEED_M_S = 0.3
"""One standard deviation of the speed while none is known."""
ACCELERATION_RANGES_S2, FIRST_SPEED_RANGES_S = 3.0, 0.2
"""Both in ranges to what is looked at, the least that is expected: a model may be in any unit, and its camera any size.

As much as the former are at 1.3 m, where they were chosen.
"""
FIRST_RATE_RAD_S = 0.3
"""The same of the angular rate."""
MAX_SIGMA_PART = 0.15
"""The predicted position is never taken for less certain than this part of the range."""
MAX_SIGMA_RAD = 0.2
"""Nor the orientation than this."""
MOVES, TURNS = slice(0, 21, 7), slice(21, 36, 7)
"""Where the variances of translation and rotation stand in a flat covariance (36,)."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Pose, its covariance (6, 6), its velocity (6,) per second as a twist of the camera (None while unknown)."""

    cam_from_world: Pose
    covariance: Array
    velocity: Array | None = None

    def predict(self, dt_s: float, range_m: float) -> tuple[Pose, Array]:
        """Pose after dt_s and its covariance (6, 6), at a range_m from what is looked at."""
        velocity = np.zeros(6) if self.velocity is None else self.velocity
        xi = velocity * MEMORY_S * (1 - np.exp(-dt_s / MEMORY_S))
        pose = Pose(*move(self.cam_from_world.rotation, self.cam_from_world.translation, xi))
        acceleration = max(ACCELERATION_M_S2, ACCELERATION_RANGES_S2 * range_m)
        shift, turn = 0.5 * acceleration * dt_s**2, 0.5 * ANGULAR_ACCELERATION_RAD_S2 * dt_s**2
        if self.velocity is None:
            shift += max(FIRST_SPEED_M_S, FIRST_SPEED_RANGES_S * range_m) * dt_s
            turn += FIRST_RATE_RAD_S * dt_s
        covariance = self.covariance.copy()
        covariance.flat[MOVES] += min(shift, MAX_SIGMA_PART * range_m) ** 2
        covariance.flat[TURNS] += min(turn, MAX_SIGMA_RAD) ** 2
        return pose, covariance

    def misfit(self, cam_from_world: Pose) -> float:
        """Squared distance of a pose from this one in standard deviations (Mahalanobis)."""
        away = twist_between(
            self.cam_from_world.rotation, self.cam_from_world.translation, cam_from_world.rotation,
            cam_from_world.translation,
        )  # fmt: skip
        return float(away @ np.linalg.solve(self.covariance, away))

    def update(self, cam_from_world: Pose, covariance: Array, dt_s: float) -> "Motion":
        """Motion after a new pose, dt_s after this one."""
        if dt_s <= 0:
            return Motion(cam_from_world, covariance, self.velocity)
        was = self.cam_from_world
        moved = twist_between(was.rotation, was.translation, cam_from_world.rotation, cam_from_world.translation) / dt_s
        return Motion(cam_from_world, covariance, moved if self.velocity is None else 0.2 * self.velocity + 0.8 * moved)
