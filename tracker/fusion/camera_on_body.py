"""What the vehicle knows of its camera's pose on the body: a fixed mount, or a gimbal by its encoders' readings."""

from bisect import bisect_left
from typing import NamedTuple, Protocol

import numpy as np

from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.pose import Array, Pose

KEPT_NS = 60 * 10**9
"""Age up to which readings are kept, ns: a tracker's answer is not as late."""


class CameraOnBody(NamedTuple):
    """Pose of the camera on the body, with the error xi (6,): cam_from_body_true = exp(xi) @ cam_from_body.

    xi is the sum of white noise with the covariance `white` (6, 6) and of an error that is constant in flight, with the
    covariance `constant` (6, 6).
    """

    cam_from_body: Pose
    white: Array
    constant: Array


class KnownMount(Protocol):
    """Knowledge of a camera's mount."""

    def at(self, stamp_ns: int) -> CameraOnBody:
        """The camera on the body at a time in ns."""
        ...


class FixedMount:
    """A mount without error that never moves; `camera_bias_m` and `camera_bias_rad` of the filter are tolerances."""

    def __init__(self, cam_from_body: Pose) -> None:
        self._known = CameraOnBody(cam_from_body, np.zeros((6, 6)), np.zeros((6, 6)))

    def at(self, stamp_ns: int) -> CameraOnBody:
        """The same at any time."""
        return self._known


class MeasuredGimbal:
    """A gimbal whose joints are known by their encoders alone.

    Angles are interpolated linearly between the two readings next to a time, or extrapolated from the last two. Their
    noise is that of the encoder's data sheet, to first order in the camera's pose; the error of the interpolation is
    neglected.
    """

    def __init__(self, gimbal: Gimbal) -> None:
        self._gimbal = gimbal
        self._stamps: list[int] = []
        self._angles: list[Array] = []

    def read(self, stamp_ns: int, angles_rad: Array) -> None:
        """Process a reading (k,) of the joints that exist; stamps increase. ValueError when it is not finite."""
        angles = np.array(angles_rad, dtype=np.float64)
        if angles.shape != (len(self._gimbal.joints),) or not np.isfinite(angles).all():
            raise ValueError(f"reading at {stamp_ns}: a finite angle of each joint is needed, {self._gimbal.axes}")
        self._stamps.append(stamp_ns)
        self._angles.append(angles)
        if self._stamps[0] < stamp_ns - KEPT_NS:
            del self._stamps[0], self._angles[0]

    def at(self, stamp_ns: int) -> CameraOnBody:
        """The camera on the body at a time in ns; ValueError before the first reading has arrived."""
        if not self._stamps:
            raise ValueError(f"no reading of the encoders yet: the camera's pose at {stamp_ns} is unknown")
        last = min(max(bisect_left(self._stamps, stamp_ns), 1), len(self._stamps) - 1)
        first = max(last - 1, 0)
        span = self._stamps[last] - self._stamps[first]
        share = (stamp_ns - self._stamps[first]) / span if span else 1.0
        angles = (1.0 - share) * self._angles[first] + share * self._angles[last]
        encoder, twists = self._gimbal.encoder, self._gimbal.twists_at(angles)
        by_angle = twists @ twists.T
        white = ((1.0 - share) ** 2 + share**2) * encoder.white_rad**2 * by_angle
        return CameraOnBody(self._gimbal.cam_from_body_at(angles), white, encoder.zero_rad**2 * by_angle)
