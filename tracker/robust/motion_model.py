"""Prediction: the pose at the next frame with its covariance, by first-order Gauss-Markov motion."""

from dataclasses import dataclass

import numpy as np

from uavbench.tracker.geometry_kernels import se3_exp_left, se3_log_left
from uavbench.tracker.robust.config.robust import MotionConfig
from uavbench.trajectories.pose import Array, Pose

FAR_CHI2 = 12.6
"""Squared Mahalanobis distance beyond which a pose is far: 95 % of a chi-square with six degrees of freedom."""
THOUSANDTH = 3.09
"""Standard deviations below the mean of a normal distribution that one draw in a thousand lies."""
MOVES, TURNS = slice(0, 21, 7), slice(21, 36, 7)
"""Places of the variances of translation and rotation in a flat covariance (36,)."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Pose, its covariance (6, 6), its velocity (6,) per second as a twist of the camera (None while unknown)."""

    cam_from_world: Pose
    covariance: Array
    velocity: Array | None = None

    def predict(self, dt_s: float, range_m: float, config: MotionConfig) -> "Motion":
        """Pose after dt_s with its covariance, at a range_m from what is looked at; its velocity is left out."""
        velocity = np.zeros(6) if self.velocity is None else self.velocity
        xi = velocity * config.memory_s * (1 - np.exp(-dt_s / config.memory_s))
        pose = Pose(*se3_exp_left(self.cam_from_world.rotation, self.cam_from_world.translation, xi))
        rate = config.initial_rate_1_s if self.velocity is None else 0.0
        shift = rate * dt_s + 0.5 * config.acceleration_ranges_s2 * dt_s**2
        turn = rate * dt_s + 0.5 * config.angular_acceleration_rad_s2 * dt_s**2
        covariance = self.covariance.copy()
        covariance.flat[MOVES] += (min(shift, config.max_sigma) * range_m) ** 2
        covariance.flat[TURNS] += min(turn, config.max_sigma) ** 2
        return Motion(pose, covariance)

    def spread_m(self, range_m: float) -> float:
        """Standard deviation of where something at a range_m is expected, by position and orientation together."""
        variance = self.covariance.flat[MOVES].sum() + range_m**2 * self.covariance.flat[TURNS].sum()
        return float(np.sqrt(variance))

    def squared_mahalanobis(self, cam_from_world: Pose) -> float:
        """Squared Mahalanobis distance of a pose from this one."""
        at = self.cam_from_world
        away = se3_log_left(at.rotation, at.translation, cam_from_world.rotation, cam_from_world.translation)
        return float(away @ np.linalg.solve(self.covariance, away))

    def update(self, cam_from_world: Pose, covariance: Array, dt_s: float) -> "Motion":
        """Motion after a new pose, dt_s after this one."""
        if dt_s <= 0:
            return Motion(cam_from_world, covariance, self.velocity)
        was = self.cam_from_world
        moved = se3_log_left(was.rotation, was.translation, cam_from_world.rotation, cam_from_world.translation) / dt_s
        return Motion(cam_from_world, covariance, moved)


@dataclass(frozen=True)
class PredictionErrors:
    """How large the errors of a run's predictions are: sum and number of squared Mahalanobis distances, forgetting."""

    sum: float = 0.0
    count: float = 0.0

    def updated(self, predicted: Motion, cam_from_world: Pose, rate: float) -> "PredictionErrors":
        """With one more frame, which makes up at least a share `rate` of what is known."""
        chi2 = predicted.squared_mahalanobis(cam_from_world)
        return PredictionErrors((1 - rate) * self.sum + chi2, (1 - rate) * self.count + 1)

    @property
    def scale(self) -> float:
        """Factor on the predictions' covariances with which they are right, an upper bound (99.9 %), at most 1.

        A sum of n squared distances is chi-square with 6 n degrees of freedom (Wilson & Hilferty 1931).
        """
        if not self.count:
            return 1.0
        freedom = 6 * self.count
        part = 2 / (9 * freedom)
        return min(1.0, float(self.sum / (freedom * (1 - part - THOUSANDTH * np.sqrt(part)) ** 3)))


def sigmas(sigma: float, range_m: float) -> Array:
    """Covariance (6, 6) of a pose known to sigma, in parts of the range and in rad."""
    return np.diag([(sigma * range_m) ** 2] * 3 + [sigma**2] * 3)
