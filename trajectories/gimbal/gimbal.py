"""A gimbal for a camera, as a mount of a suite's file names it."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import CAM_FROM_FORWARD_BODY, Motion, Mount, check_offset
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.axes import GimbalAxis, Joints, PitchAxis, RollAxis, YawAxis, turned
from uavbench.trajectories.gimbal.encoder import Encoder
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.gimbal.pointing import Aim, Axes, heading, joints_for
from uavbench.trajectories.pose import Array, Pose

Mode = Literal["stabilized", "target"]
LEAST_TO_TARGET_M = 0.1
"""Least distance from the camera's centre to its target, metres; a nearer one is the vehicle itself."""
BEYOND_RAD = 1e-3
"""Angle beyond the stops from which a target counts as out of reach, rad: less than a pixel's at most lenses."""


@dataclass(frozen=True, kw_only=True)
class Gimbal:
    """A camera on a gimbal with servos and encoders on its joints.

    From the body to the camera they are yaw, roll and pitch; axes names those that exist. They meet in the camera's
    centre, at offset_m on the body; yaw_deg (to the left) is the direction in which the camera looks with all joints at
    zero, which is level on a level body. Mode `stabilized` holds pitch_deg above the horizon and roll_deg (clockwise)
    and follows the vehicle's heading; `target` points the camera at target_m in the world, by default the middle of the
    structure, with roll_deg. The servos know the attitude of the body exactly and lag behind it by their bandwidth:
    that is the remaining motion of the image. Friction, and the forces of the gimbal on the vehicle, are neglected.
    UserError for angles beyond the stops, or keys that the mode has no use for.
    """

    axes: Axes = "yaw-roll-pitch"
    mode: Mode = "stabilized"
    pitch_deg: Annotated[float, Interval(ge=-180, le=180)] = 0.0
    roll_deg: Annotated[float, Interval(ge=-80, le=80)] = 0.0
    yaw_deg: Annotated[float, Interval(ge=-360, le=360)] = 0.0
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    target_m: tuple[float, float, float] | None = None
    yaw_axis: YawAxis = field(default_factory=YawAxis)
    roll_axis: RollAxis = field(default_factory=RollAxis)
    pitch_axis: PitchAxis = field(default_factory=PitchAxis)
    encoder: Encoder = field(default_factory=Encoder)

    def __post_init__(self) -> None:
        check_offset(self.offset_m)
        for name, joint in (("pitch_deg", self.pitch_axis), ("roll_deg", self.roll_axis)):
            angle = getattr(self, name)
            if not joint.least_deg <= angle <= joint.greatest_deg:
                raise UserError(
                    f"{name} {angle:g} is beyond the stops of its axis, {joint.least_deg:g} to "
                    f"{joint.greatest_deg:g} degrees; give an angle between them, or widen least_deg and greatest_deg "
                    f"of {name.replace('deg', 'axis')}"
                )
        if self.axes == "pitch" and self.roll_deg:
            raise UserError(f"roll_deg {self.roll_deg:g}: axes = 'pitch' has no roll axis; leave it out")
        for which, given in {"yaw": self.yaw_axis != YawAxis(), "roll": self.roll_axis != RollAxis()}.items():
            if given and which not in self.joints:
                raise UserError(f"{which}_axis: axes = {self.axes!r} has no {which} axis; leave it out")
        if self.mode == "target" and self.pitch_deg:
            raise UserError(f"pitch_deg {self.pitch_deg:g}: mode = 'target' points the camera itself; leave it out")
        if self.mode == "stabilized" and self.target_m is not None:
            raise UserError("target_m: mode = 'stabilized' does not look at it; set mode = 'target'")

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of its joints, from the body to the camera."""
        return tuple(self.axes.split("-"))

    @property
    def at_rest(self) -> Mount:
        """The mount of the camera on a level body, which paths are planned with."""
        return Mount(self.pitch_deg, self.yaw_deg, self.roll_deg, self.offset_m)

    @property
    def body_from_base(self) -> Array:
        """Rotation (3, 3) from the gimbal's base, x in the direction of view with all joints at zero, to the body."""
        return turned(math.radians(self.yaw_deg), 0.0, 0.0)

    def cam_from_body(self, yaw_rad: float, roll_rad: float, pitch_rad: float) -> Pose:
        """Pose of the camera on the body for angles of the joints."""
        body_from_view = exact.product(self.body_from_base, turned(yaw_rad, roll_rad, pitch_rad))
        return Pose(exact.product(body_from_view, CAM_FROM_FORWARD_BODY.T), np.array(self.offset_m)).inverse()

    @property
    def axes_of_joints(self) -> tuple[GimbalAxis, ...]:
        """Dynamics and limits of yaw, roll and pitch joint; those that do not exist stay at zero."""
        return (self.yaw_axis, self.roll_axis, self.pitch_axis)

    def commands(self, world_from_body: Pose, target_m: Array) -> Joints:
        """Angles that hold the camera's attitude, or point it at the target, on a body at a pose."""
        world_from_base = world_from_body.rotation
        if self.yaw_deg:
            world_from_base = exact.product(world_from_base, self.body_from_base)
        aim = Aim(heading(world_from_base), math.radians(self.pitch_deg), math.radians(self.roll_deg))
        if self.mode == "target":
            x, y, z = (target_m - world_from_body.transform(np.array([self.offset_m]))[0]).tolist()
            aim = Aim(math.atan2(y, x), math.atan2(z, math.hypot(x, y)), aim.roll_rad)
        return joints_for(self.axes, world_from_base, aim)

    def cam_from_body_at(self, angles_rad: Array) -> Pose:
        """Pose of the camera on the body for angles (k,) of the joints that exist, in the order of `joints`."""
        angles = {f"{joint}_rad": float(angle) for joint, angle in zip(self.joints, angles_rad, strict=True)}
        return self.cam_from_body(**{"yaw_rad": 0.0, "roll_rad": 0.0, **angles})

    def twists_at(self, angles_rad: Array) -> Array:
        """Jacobian (6, k) of the camera's twist by the angles (k,) of the joints that exist, at these angles.

        To first order `cam_from_body_at(angles + d) = exp(twists_at(angles) @ d) @ cam_from_body_at(angles)`. All axes
        meet in the camera's centre: its translation, the first three rows, is zero.
        """
        angles = dict(zip(self.joints, angles_rad.tolist(), strict=True))
        yaw_from_pitch = turned(0.0, angles.get("roll", 0.0), angles.get("pitch", 0.0))
        roll_from_pitch = turned(0.0, 0.0, angles.get("pitch", 0.0))
        axes = {"yaw": -yaw_from_pitch[2], "roll": -roll_from_pitch[0], "pitch": np.array([0.0, 1.0, 0.0])}
        twists = np.zeros((6, len(self.joints)))
        twists[3:] = CAM_FROM_FORWARD_BODY @ np.column_stack([axes[joint] for joint in self.joints])
        return twists

    def along(self, motion: Motion, target_m: Array) -> GimbalMotion:
        """The gimbal along a motion; target_m (3,): what it looks at unless it has its own target_m."""
        return GimbalMotion(self, motion, target_m if self.target_m is None else np.array(self.target_m))

    def unreached(self, motion: GimbalMotion, stamps_ns: NDArray[np.int64]) -> str:
        """What keeps the camera from its target at the times (ns) of its frames, "" if nothing does.

        UserError when the stops keep it from the target in all frames, or the camera is at the target.
        """
        if self.mode != "target":
            return ""
        away_m = motion.to_target_m(stamps_ns)
        near = int(np.argmin(away_m))
        if away_m[near] < LEAST_TO_TARGET_M:
            raise UserError(
                f"mount.target_m: frame {near}: the camera is {away_m[near]:.3f} m from it, at the vehicle itself; "
                "move the target or the path"
            )
        beyond = motion.beyond_stops_rad(stamps_ns)
        missed = np.atleast_1d((beyond > BEYOND_RAD).any(axis=1))
        if not missed.any():
            return ""
        joint = ("yaw", "roll", "pitch")[int(np.argmax(beyond.max(axis=0)))]
        axis = getattr(self, f"{joint}_axis")
        what = (
            f"the stops of {joint}_axis, {axis.least_deg:g} to {axis.greatest_deg:g} degrees, keep it from its target "
            f"in {int(missed.sum())} of {len(missed)} frames, by up to {math.degrees(float(beyond.max())):.1f} degrees"
        )
        if missed.all():
            raise UserError(f"mount.target_m: {what}; widen the stops, or move the target or the path")
        return what
