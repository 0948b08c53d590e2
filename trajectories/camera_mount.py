"""Extrinsics of the camera on the vehicle."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Angle, Array, Pose, rotation_exp

MAIN = "camera"
"""Name of the main camera, reserved."""
CAM_FROM_FORWARD_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Axis change from a body (x forward, y left, z up) to a camera (x right, y down, z forward) that looks along x."""
FARTHEST_M = 10.0
"""Largest coordinate of a camera or sensor on the body, m: the radius of the largest air taxis; mm are beyond."""


def check_offset(offset_m: tuple[float, float, float]) -> None:
    """ValueError for an offset (x, y, z) in metres that is beyond FARTHEST_M."""
    if not all(abs(each) <= FARTHEST_M for each in offset_m):
        raise ValueError(f"offset_m {list(offset_m)} is more than {FARTHEST_M:g} m from the body; give it in metres")


class Motion(Protocol):
    """Poses `world_from_body` of a flight by row; rows may still be added."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of all rows, including those not flown yet."""
        ...

    def __len__(self) -> int:
        """Number of rows so far."""
        ...

    def pose(self, row: int) -> Pose:
        """Pose of a row."""
        ...


class MountSpec(Protocol):
    """How a camera is attached to the body: fixed, or on a gimbal."""

    @property
    def at_rest(self) -> "Mount":
        """The fixed mount that paths are planned with: the camera's centre, and its nominal direction of view."""
        ...

    def along(self, motion: Motion, target_m: Array) -> Callable[[int], Pose]:
        """`cam_from_body` at any time (ns) of a motion; target_m (3,): what is inspected, in the world."""
        ...


@dataclass(frozen=True)
class Mount:
    """Camera mount; the default looks along the body's x axis from the body's origin.

    It is rotated from there about the body's z axis by yaw_deg (positive to the left), then about its own lateral axis
    by pitch_deg (positive upwards: -20 looks 20 degrees down), then about its optical axis by roll_deg (positive
    clockwise in the direction of view). offset_m is the camera centre in the body frame. ValueError for one beyond
    FARTHEST_M.
    """

    pitch_deg: Angle = 0.0
    yaw_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_offset(self.offset_m)

    @property
    def cam_from_body(self) -> Pose:
        """Pose that maps points of the body frame to the camera frame (x right, y down, z forward)."""
        yaw, pitch, roll = np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg])
        axes = rotation_exp(np.array([[0.0, 0.0, yaw], [0.0, -pitch, 0.0], [roll, 0.0, 0.0]]))
        body_from_turned = exact.product(exact.product(axes[0], axes[1]), axes[2])
        body_from_cam = Pose(exact.product(body_from_turned, CAM_FROM_FORWARD_BODY.T), np.array(self.offset_m))
        return body_from_cam.inverse()

    @property
    def at_rest(self) -> "Mount":
        """The mount itself."""
        return self

    def along(self, motion: Motion, target_m: Array) -> Callable[[int], Pose]:
        """`cam_from_body`, the same at any time."""
        fixed = self.cam_from_body
        return lambda stamp_ns: fixed
