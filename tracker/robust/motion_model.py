"""Prediction: the pose at the next frame with its covariance, by first-order Gauss-Markov motion."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import se3_exp_left, se3_log_left, squared_mahalanobis
from uavbench.tracker.robust.config.robust import MotionConfig
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array, Pose

FAR_CHI2 = 12.6
"""Squared Mahalanobis distance beyond which a pose is far: 95 % quantile of chi-square with six degrees of freedom."""
THOUSANDTH = 3.09
"""99.9 % quantile of the standard normal distribution."""
TRANSLATION, ROTATION = slice(0, 21, 7), slice(21, 36, 7)
"""Indices of the variances of translation and rotation in a flat covariance (36,)."""
NO_VELOCITY = np.zeros(6)


class Moved(NamedTuple):
    """A pose (R, t) with its covariance (6, 6)."""

    R: Array
    t: Array
    covariance: Array


@compiled("f2 f1 f1 f2 (f0 f0) (f0 f0)")
def moved(
    R: Array,
    t: Array,
    velocity: Array,
    covariance: Array,
    lasting_s: tuple[float, float],
    sigmas: tuple[float, float],
) -> Moved:
    """(R, t) moved at a velocity (6,), and the covariance (6, 6) with that of the motion on each axis added.

    lasting_s: two factors of the time that it lasts; sigmas: standard deviations in m and rad.
    """
    xi, grown = np.empty(6), covariance.copy()
    for i in range(6):
        xi[i] = velocity[i] * lasting_s[0] * lasting_s[1]
    for i in range(3):
        grown[i, i] += sigmas[0] ** 2
        grown[i + 3, i + 3] += sigmas[1] ** 2
    pose = se3_exp_left(R, t, xi)
    return Moved(pose.R, pose.t, grown)


class Velocities(NamedTuple):
    """The velocity (6,) from one pose to the next, and the mean with it."""

    now: Array
    mean: Array


@compiled("f2 f1 f2 f1 f1 f0 f0")
def velocities(R: Array, t: Array, R_to: Array, t_to: Array, mean: Array, dt_s: float, part: float) -> Velocities:
    """Velocities at which (R_to, t_to) is reached from (R, t) in dt_s; the new one is a part of the mean (6,)."""
    now, new_mean = se3_log_left(R, t, R_to, t_to), np.empty(6)
    for i in range(6):
        now[i] /= dt_s
        new_mean[i] = mean[i] + part * (now[i] - mean[i])
    return Velocities(now, new_mean)


@dataclass(frozen=True, eq=False)
class Motion:
    """Pose, covariance and velocity of the camera.

    Errors and velocity are twists in the camera frame, translation first: the true pose is exp(xi) cam_from_world. The
    covariance (6, 6) is in m^2 and rad^2, the velocity (6,) in m/s and rad/s, None while unknown; mean_velocity (6,):
    its exponentially weighted mean, with the time constant memory_s.
    """

    cam_from_world: Pose
    covariance: Array
    velocity: Array | None = None
    mean_velocity: Array | None = None

    def predict(self, dt_s: float, range_m: float, config: MotionConfig) -> "Motion":
        """Pose and covariance after dt_s, without velocity; range_m is the distance to the structure.

        The velocity decays with the time constant memory_s.
        """
        velocity = NO_VELOCITY if self.velocity is None else self.velocity
        lasting_s = config.memory_s, ended_part(dt_s, config.memory_s)
        rate = config.initial_rate_1_s if self.velocity is None else 0.0
        shift = rate * dt_s + 0.5 * config.acceleration_ranges_s2 * dt_s**2
        turn = rate * dt_s + 0.5 * config.angular_acceleration_rad_s2 * dt_s**2
        sigmas = min(shift, config.max_sigma) * range_m, min(turn, config.max_sigma)
        at = self.cam_from_world
        R, t, covariance = unchecked(moved)(at.rotation, at.translation, velocity, self.covariance, lasting_s, sigmas)
        return Motion(Pose.owning(R, t), covariance)

    def carried_on(self, dt_s: float) -> Pose:
        """Pose after dt_s if the mean velocity lasts: on a circle or a straight line, and still without a velocity."""
        if self.mean_velocity is None:
            return self.cam_from_world
        at = self.cam_from_world
        return Pose(*se3_exp_left(at.rotation, at.translation, self.mean_velocity * dt_s))

    def spread_m(self, range_m: float) -> float:
        """Standard deviation in m of the predicted position of a point at range_m, of translation and rotation."""
        variance = self.covariance.flat[TRANSLATION].sum() + range_m**2 * self.covariance.flat[ROTATION].sum()
        return float(np.sqrt(variance))

    def squared_mahalanobis(self, cam_from_world: Pose) -> float:
        """Squared Mahalanobis distance of a pose from this one, inf where the covariance is not positive definite."""
        at, to = self.cam_from_world, cam_from_world
        return squared_mahalanobis(at.rotation, at.translation, to.rotation, to.translation, self.covariance)

    def update(self, cam_from_world: Pose, covariance: Array, dt_s: float, memory_s: float) -> "Motion":
        """Motion at a new pose, dt_s after this one; velocities are kept if dt_s is 0."""
        if dt_s <= 0:
            return Motion(cam_from_world, covariance, self.velocity, self.mean_velocity)
        was, now, mean = self.cam_from_world, cam_from_world, self.mean_velocity
        poses = was.rotation, was.translation, now.rotation, now.translation
        known = NO_VELOCITY if mean is None else mean
        velocity, new_mean = velocities(*poses, known, dt_s, ended_part(dt_s, memory_s))
        return Motion(cam_from_world, covariance, velocity, velocity if mean is None else new_mean)


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of a run's predictions: exponentially weighted sum and count of squared Mahalanobis distances."""

    sum: float = 0.0
    count: float = 0.0

    def updated(self, predicted: Motion, cam_from_world: Pose, rate: float) -> "PredictionErrors":
        """Errors with one more frame; rate, in [0, 1]: least weight of a new frame (exponential forgetting)."""
        chi2 = predicted.squared_mahalanobis(cam_from_world)
        return PredictionErrors((1 - rate) * self.sum + chi2, (1 - rate) * self.count + 1)

    @property
    def scale(self) -> float:
        """Upper confidence bound (99.9 %) of the factor that makes the predictions' covariances consistent, at most 1.

        The sum is treated as chi-square with 6 count degrees of freedom, an approximation, since old frames count less;
        its quantile is that of Wilson & Hilferty (1931).
        """
        if not self.count:
            return 1.0
        freedom = 6 * self.count
        part = 2 / (9 * freedom)
        return min(1.0, self.sum / (freedom * (1 - part - THOUSANDTH * math.sqrt(part)) ** 3))


def ended_part(dt_s: float, memory_s: float) -> float:
    """Part of what decays with a time constant that is gone after dt_s."""
    return float(1 - np.exp(-dt_s / memory_s))


def isotropic_covariance(sigma: float, range_m: float) -> Array:
    """Covariance (6, 6) of a pose, m^2 and rad^2; sigma: standard deviation, relative to the range and in rad."""
    covariance = np.zeros((6, 6))
    variances = covariance.reshape(36)
    variances[TRANSLATION], variances[ROTATION] = (sigma * range_m) ** 2, sigma**2
    return covariance
