"""Angles that the joints of a gimbal are commanded to, from the attitude of the body."""

import math
from dataclasses import dataclass
from typing import Literal

from uavbench.trajectories.gimbal.axes import Joints
from uavbench.trajectories.pose import Array

Axes = Literal["yaw-roll-pitch", "roll-pitch", "pitch"]
"""Joints of a gimbal from the body to the camera, the order of camera gimbals on vehicles."""


@dataclass(frozen=True)
class Aim:
    """Attitude that the camera should have in the world: heading_rad from x, pitch_rad above the horizon, roll_rad."""

    heading_rad: float
    pitch_rad: float
    roll_rad: float


def heading(world_from_base: Array) -> float:
    """Heading in rad of the base's x axis, from the world's x axis counter-clockwise."""
    return math.atan2(float(world_from_base[1, 0]), float(world_from_base[0, 0]))


def joints_for(axes: Axes, world_from_base: Array, aim: Aim) -> Joints:
    """Angles of the joints that give the camera an attitude, on a base with a rotation (3, 3).

    Three axes reach it exactly. Without the yaw axis the camera keeps the heading that it has, with the roll axis
    levelled; with the pitch axis alone it does not roll against the body.
    """
    if axes == "yaw-roll-pitch":
        return _euler_zxy(world_from_base, aim)
    x, y, z = map(float, world_from_base[2])  # the world's vertical in the base
    roll = aim.roll_rad + math.atan2(-y, z) if axes == "roll-pitch" else 0.0
    up = z * math.cos(roll) - y * math.sin(roll)
    return Joints(0.0, roll, aim.pitch_rad - math.atan2(x, up))


def _euler_zxy(world_from_base: Array, aim: Aim) -> Joints:
    """Yaw, roll and pitch that turn a base to an attitude; in plain numbers, as it is asked for at every step.

    With A the attitude in the base, Rz(yaw) Rx(roll) Ry(-pitch), roll is that of its entry (2, 1), yaw that of its
    middle column and pitch that of its last row.
    """
    s, c = math.sin(aim.heading_rad), math.cos(aim.heading_rad)
    sr, cr = math.sin(aim.roll_rad), math.cos(aim.roll_rad)
    sp, cp = math.sin(aim.pitch_rad), math.cos(aim.pitch_rad)
    forward = (c * cp + s * sr * sp, s * cp - c * sr * sp, cr * sp)
    left = (-s * cr, c * cr, sr)
    up = (-c * sp + s * sr * cp, -s * sp - c * sr * cp, cr * cp)
    x, y, z = (tuple(row) for row in world_from_base.T.tolist())
    roll = math.asin(min(max(_dot(z, left), -1.0), 1.0))
    return Joints(math.atan2(-_dot(x, left), _dot(y, left)), roll, math.atan2(_dot(z, forward), _dot(z, up)))


def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
