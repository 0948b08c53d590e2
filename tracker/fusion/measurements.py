"""Measurements of the filter besides the IMU: camera poses, positions, heights, optical flow, with their models.

Each returns at a nominal state its residual, the Jacobian H of the residual with respect to the error state (sign:
residual = H error + noise), and its noise covariance.
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from uavbench.tracker.fusion.camera_on_body import CameraOnBody
from uavbench.tracker.fusion.kernels import fill_jacobian, is_positive
from uavbench.tracker.fusion.state import ERROR, FusionConfig
from uavbench.tracker.geometry_kernels import se3_log_left
from uavbench.trajectories.pose import Array, Pose, hat, read_only

POSITION, VELOCITY, ATTITUDE, SLOW = slice(0, 3), slice(3, 6), slice(6, 9), slice(15, 21)
"""Slices of the parts of the error state."""


@dataclass(frozen=True, eq=False)
class Innovation:
    """Innovation: residual (m,), its Jacobian H (m, 21) by the error state, and its noise covariance (m, m)."""

    residual: Array
    H: Array
    noise: Array


class Measurement(Protocol):
    """A measurement with which the filter can be updated; rank: order among measurements of equal stamps."""

    rank: ClassVar[int]

    @property
    def stamp_ns(self) -> int:
        """Time of the measurement, ns."""
        ...

    def innovation(self, state: Array, rate_rad_s: Array) -> Innovation | None:
        """Innovation at a nominal state (27,) and a body rate (3,) in rad/s; None if the state cannot predict it."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPose:
    """A tracker's pose, with the error xi (6,): cam_from_world_true = exp(xi) @ cam_from_world.

    xi is the sum of white noise with a covariance (6, 6) and of the slow error of the camera's poses with the
    covariance `slow` (6, 6).
    """

    rank: ClassVar[int] = 1
    stamp_ns: int
    cam_from_world: Pose
    covariance: Array
    cam_from_body: Pose
    slow: Array = field(default_factory=lambda: np.zeros((6, 6)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", checked(self.covariance, 6))
        object.__setattr__(self, "slow", read_only(self.slow, (6, 6)))
        finite("cam_from_world", self.cam_from_world.matrix)

    @classmethod
    def claimed(
        cls, stamp_ns: int, cam_from_world: Pose, covariance: Array, camera: CameraOnBody, config: FusionConfig
    ) -> "CameraPose":
        """A pose with the total covariance (6, 6) claimed by its tracker; ValueError unless positive definite.

        The error of the camera's pose on the body adds to it: cam_from_world = cam_from_body @ body_from_world, so both
        are twists on the left.
        """
        whole = checked(covariance, 6)
        return cls(
            stamp_ns=stamp_ns,
            cam_from_world=cam_from_world,
            covariance=(1.0 - config.camera_slow_share) * whole + camera.white,
            cam_from_body=camera.cam_from_body,
            slow=config.slow_covariance(whole) + camera.constant,
        )

    def innovation(self, state: Array, rate_rad_s: Array) -> Innovation:
        """Negative twist from the measured to the predicted camera, and its Jacobian."""
        twist, H = deviation(self.cam_from_world, self.cam_from_body, state)
        L = _root(self.slow)
        H[:, SLOW] = -L
        return Innovation(L @ state[21:27] - twist, H, self.covariance)


def _root(P: Array) -> Array:
    """L (6, 6) with L L' = P, a continuous function of P: Cholesky's, of a singular P the symmetric one."""
    if not P.any():
        return P
    if is_positive(P):
        return np.asarray(np.linalg.cholesky(P))
    values, vectors = np.linalg.eigh(P)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


class Deviation(NamedTuple):
    """Twist (6,) from a pose of the camera to that of a state, and the Jacobian H (6, 21) of its negative."""

    twist: Array
    H: Array


def deviation(cam_from_world: Pose, cam_from_body: Pose, state: Array) -> Deviation:
    """Deviation of a nominal state (27,) from a pose of the camera, without the slow error of its poses."""
    R, C = state[6:15].reshape(3, 3), cam_from_body
    rotation = C.rotation @ R.T
    translation = C.translation - rotation @ state[0:3]
    measured = np.ascontiguousarray(cam_from_world.rotation)  # inverses are stored column-major
    e = se3_log_left(measured, cam_from_world.translation, rotation, translation)
    after = np.empty((6, 6))
    fill_jacobian(e, after)
    by_body = after @ _turned(C)
    H = np.zeros((6, ERROR))
    H[:, POSITION] = by_body[:, :3] @ -R.T
    H[:, ATTITUDE] = -by_body[:, 3:]
    return Deviation(e, H)


@lru_cache(maxsize=1)
def _turned(cam_from_body: Pose) -> Array:
    """Adjoint (6, 6) of a pose: twists of the body as twists of the camera."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = cam_from_body.rotation
    out[:3, 3:] = hat(cam_from_body.translation) @ cam_from_body.rotation
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Position:
    """A GNSS fix: position (3,) in the world, m, of an antenna at offset_m on the body, and optionally velocity."""

    rank: ClassVar[int] = 2
    stamp_ns: int
    position_m: Array
    covariance: Array
    velocity_m_s: Array | None = None
    velocity_covariance: Array | None = None
    offset_m: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", checked(self.covariance, 3))
        finite("position_m", self.position_m)
        if (self.velocity_m_s is None) != (self.velocity_covariance is None):
            raise ValueError("velocity_m_s and velocity_covariance come together")
        if self.velocity_m_s is not None and self.velocity_covariance is not None:
            finite("velocity_m_s", self.velocity_m_s)
            object.__setattr__(self, "velocity_covariance", checked(self.velocity_covariance, 3))

    def innovation(self, state: Array, rate_rad_s: Array) -> Innovation:
        """Measured minus predicted position of the antenna, and velocity if measured."""
        R, arm = state[6:15].reshape(3, 3), np.asarray(self.offset_m, dtype=float)
        H = np.zeros((3, ERROR))
        H[:, POSITION], H[:, ATTITUDE] = np.eye(3), -R @ hat(arm)
        residual = np.asarray(self.position_m) - state[0:3] - R @ arm
        if self.velocity_m_s is None or self.velocity_covariance is None:
            return Innovation(residual, H, self.covariance)
        swing = np.cross(rate_rad_s, arm)
        H_velocity = np.zeros((3, ERROR))
        H_velocity[:, VELOCITY], H_velocity[:, ATTITUDE] = np.eye(3), -R @ hat(swing)
        H_velocity[:, 12:15] = R @ hat(arm)
        noise = np.zeros((6, 6))
        noise[:3, :3], noise[3:, 3:] = self.covariance, self.velocity_covariance
        both = np.concatenate([residual, np.asarray(self.velocity_m_s) - state[3:6] - R @ swing])
        return Innovation(both, np.vstack([H, H_velocity]), noise)


@dataclass(frozen=True, kw_only=True, eq=False)
class Height:
    """A barometer's height above the floor z = 0, m, with its standard deviation (drift included)."""

    rank: ClassVar[int] = 3
    stamp_ns: int
    height_m: float
    sigma_m: float

    def __post_init__(self) -> None:
        finite("height_m", np.array([self.height_m]))
        checked(np.array([[self.sigma_m**2]]), 1)

    def innovation(self, state: Array, rate_rad_s: Array) -> Innovation:
        """Measured minus predicted height."""
        H = np.zeros((1, ERROR))
        H[0, 2] = 1.0
        return Innovation(np.array([self.height_m - state[2]]), H, np.array([[self.sigma_m**2]]))


@dataclass(frozen=True, kw_only=True, eq=False)
class OpticalFlow:
    """A flow deck over the floor z = 0: flow (2,) in rad/s along body x and y, and the range along the body's -z.

    The model is the Crazyflie firmware's (mm_flow.c): v_x / range - w_y and v_y / range + w_x, w the body's rates.
    """

    rank: ClassVar[int] = 4
    LEAST_UPRIGHT: ClassVar[float] = 0.5
    """Least cosine of the tilt: beyond 60 degrees the deck does not see the floor below."""
    stamp_ns: int
    flow_rad_s: Array
    flow_sigma_rad_s: float
    range_m: float
    range_sigma_m: float

    def __post_init__(self) -> None:
        finite("flow_rad_s", np.array([*np.asarray(self.flow_rad_s), self.range_m]))
        checked(np.diag([self.flow_sigma_rad_s**2, self.range_sigma_m**2]), 2)

    def innovation(self, state: Array, rate_rad_s: Array) -> Innovation | None:
        """Measured minus predicted flow and range of a floor at z = 0; None when tilted too far, or below the floor."""
        R = state[6:15].reshape(3, 3)
        up = float(R[2, 2])
        if up < self.LEAST_UPRIGHT or state[2] <= 0:
            return None
        distance = state[2] / up
        v = R.T @ state[3:6]
        tilt = -R[2] @ hat(np.array([0.0, 0.0, 1.0]))  # derivative of R33 by the attitude error
        H = np.zeros((3, ERROR))
        H[2, 2] = 1.0 / up
        H[2, ATTITUDE] = -distance / up * tilt
        flow = np.array([v[0] / distance - rate_rad_s[1], v[1] / distance + rate_rad_s[0]])
        H[:2, VELOCITY] = R.T[:2] / distance
        H[:2, ATTITUDE] = hat(v)[:2] / distance
        H[:2] -= np.outer(v[:2] / distance**2, H[2])
        H[0, 13], H[1, 12] = 1.0, -1.0  # the rates are readings less the bias
        residual = np.array([*(np.asarray(self.flow_rad_s) - flow), self.range_m - distance])
        return Innovation(residual, H, np.diag([self.flow_sigma_rad_s**2] * 2 + [self.range_sigma_m**2]))


def finite(name: str, values: Array) -> None:
    """Raise ValueError when a measurement contains a value that is not finite."""
    if not np.isfinite(values).all():
        raise ValueError(f"{name} is not finite; leave out measurements without a value")


def checked(covariance: Array, n: int) -> Array:
    """A covariance (n, n), read-only; ValueError unless it is finite and positive."""
    out = read_only(covariance, (n, n))
    if not is_positive(out):
        raise ValueError("the covariance of a measurement is finite and positive; state what you do not know as large")
    return out
