"""Axes of a gimbal: dynamics and limits of its joints, and their angles."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Array, rotation_exp


class Joints(NamedTuple):
    """Angles of the joints from the outer to the inner one, rad: yaw to the left, roll clockwise, pitch upwards."""

    yaw: float
    roll: float
    pitch: float


@dataclass(frozen=True, kw_only=True)
class GimbalAxis:
    """A joint with a position servo: theta'' = w^2 (command - theta) - 2 damping w theta', w = 2 pi natural frequency.

    It lags a steadily changing command by 2 damping / w times the rate. natural_frequency_hz and damping are assumed,
    of the order of small brushless gimbals; data sheets do not state them. greatest_rate_deg_s is the rate up to which
    DJI recommends to command its gimbals (Onboard SDK, `Gimbal::AngleData`). least_deg and greatest_deg are the
    mechanical stops, at which the joint comes to rest without rebound; the defaults are assumed. There is no friction.
    ValueError for stops that leave no range around 0.
    """

    natural_frequency_hz: Annotated[float, Interval(gt=0, le=100)] = 10.0
    damping: Annotated[float, Interval(gt=0, le=2)] = 0.7
    greatest_rate_deg_s: Annotated[float, Interval(gt=0, le=5000)] = 400.0
    least_deg: Annotated[float, Interval(ge=-360, le=0)] = -180.0
    greatest_deg: Annotated[float, Interval(ge=0, le=360)] = 180.0

    def __post_init__(self) -> None:
        if not self.least_deg < self.greatest_deg:
            raise ValueError(f"least_deg {self.least_deg:g} is not below greatest_deg {self.greatest_deg:g}")


@dataclass(frozen=True, kw_only=True)
class YawAxis(GimbalAxis):
    """The outer joint, about the body's z axis; range assumed, less than one turn and a half as cables allow."""

    least_deg: Annotated[float, Interval(ge=-360, le=0)] = -270.0
    greatest_deg: Annotated[float, Interval(ge=0, le=360)] = 270.0


@dataclass(frozen=True, kw_only=True)
class RollAxis(GimbalAxis):
    """The middle joint; range assumed. Its angle stays short of 90 degrees, where yaw and pitch axes are parallel."""

    least_deg: Annotated[float, Interval(ge=-80, le=0)] = -45.0
    greatest_deg: Annotated[float, Interval(ge=0, le=80)] = 45.0


@dataclass(frozen=True, kw_only=True)
class PitchAxis(GimbalAxis):
    """The inner joint, the camera's lateral axis; range assumed, beyond the nadir and the horizon of a tilted body."""

    least_deg: Annotated[float, Interval(ge=-180, le=0)] = -130.0
    greatest_deg: Annotated[float, Interval(ge=0, le=180)] = 60.0


def turned(yaw_rad: float, roll_rad: float, pitch_rad: float) -> Array:
    """Rotation (3, 3) about z by yaw, then about x by roll, then about y by -pitch: upwards."""
    axes = rotation_exp(np.array([[0.0, 0.0, yaw_rad], [roll_rad, 0.0, 0.0], [0.0, -pitch_rad, 0.0]]))
    return exact.product(exact.product(axes[0], axes[1]), axes[2])
