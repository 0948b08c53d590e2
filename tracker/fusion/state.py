"""The filter's state, its error, and its parameters.

World z up, body x forward, y left, z up. The nominal state is position and velocity in the world, rotation
`world_from_body`, accelerometer and gyroscope bias, and the slow error of the camera's poses, in units of its standard
deviations. The error state (21,) is that of Sola, Quaternion kinematics for the error-state Kalman filter (2017),
section 5, with the attitude error in the body (eq. 234) and the slow error of the camera's poses last:

    position 0:3   velocity 3:6   attitude 6:9   accelerometer bias 9:12   gyroscope bias 12:15   slow error 15:21
"""

from dataclasses import dataclass, field

import numpy as np

from uavbench.trajectories.pose import Array, Pose, read_only

STATE, ERROR = 27, 21
"""Sizes of a nominal state (rotation as a matrix) and of its error."""
STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard acceleration of gravity (ISO 80000-3)."""


@dataclass(frozen=True, kw_only=True)
class FusionConfig:
    """The filter's assumptions on its sensors; every value is a noise, a physical bound or a probability.

    IMU noise densities follow Kalibr's model; the defaults are those of EuRoC's ADIS16448 (Burri et al. 2016). A
    tracker's error is not white: the share `camera_slow_share` of the covariance that it claims for a pose is a slow
    error, a first-order Gauss-Markov process with the time constant `camera_slow_s`, and the rest is white noise.
    camera_bias_m and camera_bias_rad are added to the slow error for what cannot be observed in images: the tolerances
    of the structure as built and of the camera's mounting; the defaults are for a simulation, which has none. Share and
    time constant are those of the errors of `robust`, whitened by its covariances, on 15 flights of the suite
    gate-small and five of other paths and structures: their autocorrelation is 0.6 between frames at 15 Hz (median; 0.2
    to 0.8), 0.4 after 1 s and 0.2 after 2 s.
    A measurement whose normalized innovation exceeds the quantile `gate` of its chi-square distribution is weighted
    down, so that it moves the state no further than one at the gate; beyond twice the gate, in standard deviations, it
    is rejected. After `doubt_after` consecutive rejected camera poses the filter's covariance is inflated until one is
    accepted.
    history_s: largest delay of a measurement.
    """

    accel_noise_m_s2_sqrt_hz: float = 2.0e-3
    gyro_noise_rad_s_sqrt_hz: float = 1.6968e-4
    accel_walk_m_s3_sqrt_hz: float = 3.0e-3
    gyro_walk_rad_s2_sqrt_hz: float = 1.9393e-5
    camera_slow_share: float = 0.7
    camera_slow_s: float = 2.0
    camera_bias_m: float = 0.0002
    camera_bias_rad: float = 0.0001
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2
    gate: float = 0.999
    doubt_after: int = 5
    history_s: float = 2.0

    def __post_init__(self) -> None:
        noises = (
            self.accel_noise_m_s2_sqrt_hz, self.gyro_noise_rad_s_sqrt_hz, self.accel_walk_m_s3_sqrt_hz,
            self.gyro_walk_rad_s2_sqrt_hz, self.camera_bias_m, self.camera_bias_rad,
        )  # fmt: skip
        if not all(np.isfinite(v) and v >= 0 for v in noises):
            raise ValueError("noise densities and biases are finite and not negative")
        if not 0 <= self.camera_slow_share < 1:
            raise ValueError("camera_slow_share is a share, and below 1: some of every pose's error is its own")
        if not (0 < self.gate < 1 and self.camera_slow_s > 0 and self.history_s > 0 and self.doubt_after >= 1):
            raise ValueError("gate lies between 0 and 1; camera_slow_s, history_s and doubt_after are positive")

    @property
    def densities(self) -> Array:
        """Process noise (8,) in the order of the kernels."""
        return np.array([
            self.accel_noise_m_s2_sqrt_hz, self.gyro_noise_rad_s_sqrt_hz, self.accel_walk_m_s3_sqrt_hz,
            self.gyro_walk_rad_s2_sqrt_hz, 1.0, 1.0, self.camera_slow_s, self.gravity_m_s2,
        ])  # fmt: skip

    def slow_covariance(self, claimed: Array) -> Array:
        """Covariance (6, 6) of the slow part of a pose's error; claimed: total covariance (6, 6) by the tracker."""
        bias = np.repeat([self.camera_bias_m, self.camera_bias_rad], 3) ** 2
        return np.asarray(self.camera_slow_share * np.asarray(claimed) + np.diag(bias))


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """State of the filter at a stamp.

    velocity_m_s in the world; biases as contained in the readings; angular_velocity_rad_s (3,) in the body, None before
    the first IMU sample; covariance (15, 15) of the error state, in the order of this module's docstring, without the
    slow error of the camera's poses.
    """

    stamp_ns: int
    world_from_body: Pose
    velocity_m_s: Array
    accel_bias_m_s2: Array = field(default_factory=lambda: np.zeros(3))
    gyro_bias_rad_s: Array = field(default_factory=lambda: np.zeros(3))
    angular_velocity_rad_s: Array | None = None
    covariance: Array

    def __post_init__(self) -> None:
        for name in ("velocity_m_s", "accel_bias_m_s2", "gyro_bias_rad_s"):
            object.__setattr__(self, name, read_only(getattr(self, name), (3,)))
        covariance = read_only(self.covariance, (15, 15))
        if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] < -1e-9 * np.abs(covariance).max():
            raise ValueError("the covariance is finite, symmetric and not negative")
        object.__setattr__(self, "covariance", covariance)

    @classmethod
    def at_rest(
        cls,
        stamp_ns: int,
        world_from_body: Pose,
        *,
        position_m: float,
        attitude_rad: float,
        velocity_m_s: float = 0.01,
        accel_bias_m_s2: float = 0.05,
        gyro_bias_rad_s: float = 0.01,
    ) -> "Estimate":
        """Estimate at rest at a pose with these standard deviations, each of one axis."""
        sigmas = np.repeat([position_m, velocity_m_s, attitude_rad, accel_bias_m_s2, gyro_bias_rad_s], 3)
        return cls(
            stamp_ns=stamp_ns,
            world_from_body=world_from_body,
            velocity_m_s=np.zeros(3),
            covariance=np.diag(sigmas**2),
        )

    def pack(self) -> Array:
        """Nominal state (27,) for the kernels, with a slow error of zero."""
        pose = self.world_from_body
        return np.concatenate([
            pose.translation, self.velocity_m_s, pose.rotation.ravel(), self.accel_bias_m_s2, self.gyro_bias_rad_s,
            np.zeros(6),
        ])  # fmt: skip
