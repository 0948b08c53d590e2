"""Paths along a structure: facade raster, girder follow, bridge underside, waypoints."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError, refuse_idle
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M, SETTINGS
from uavbench.trajectories.files.tables import line_of_row, numbers
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Planned, planned
from uavbench.trajectories.paths.smooth_motion import fly_through, stop_and_go
from uavbench.trajectories.paths.timing import timed_rows
from uavbench.trajectories.pose import Angle, Array

YAW_RATE_RAD_S = np.radians(45.0)
"""Maximum yaw rate of a planned path."""
MOST_LANES = 10_000
"""Maximum number of lanes on one facade: 1 km at a spacing of 10 cm."""


@dataclass(frozen=True)
class Frame:
    """The structure's extent (low, high) along a bearing, across it (to the left) and upwards, metres."""

    along: Array
    across: Array
    ahead: tuple[float, float]
    aside: tuple[float, float]
    up: tuple[float, float]

    @classmethod
    def of(cls, obstacles: ObstacleMesh, degrees: float) -> "Frame":
        """Frame along a bearing, counter-clockwise from the world's x axis."""
        angle = np.radians(degrees)
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        used = obstacles.vertices[np.unique(obstacles.triangles)]
        a, b, z = exact.product(used[:, :2], along), exact.product(used[:, :2], across), used[:, 2]
        extents = [(float(v.min()), float(v.max())) for v in (a, b, z)]
        return cls(along, across, *extents)

    def point(self, ahead: float, aside: float, height: float) -> list[float]:
        """World coordinates of a point of this frame, metres."""
        return [*(ahead * self.along + aside * self.across), height]


@dataclass(frozen=True)
class FacadeRaster:
    """Lawn-mower pattern in front of a facade, facing it, with a stop at every corner of the pattern.

    The facade faces the bearing facade_deg. Lanes run across it, lane_spacing_m apart, from from_height_m to
    to_height_m (by default that of the structure), distance_m in front of it, and end margin_m inside its edges.
    The whole path takes duration_s, or is flown at speed_m_s (default 0.8).
    """

    facade_deg: Angle = 0.0
    distance_m: Annotated[float, Gt(0)] = 2.0
    lane_spacing_m: Annotated[float, Gt(0)] = 1.0
    from_height_m: Annotated[float, Gt(0)] = 1.0
    to_height_m: Annotated[float, Gt(0)] | None = None
    margin_m: float = 0.0
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.8
    usual_speed_m_s: ClassVar[float] = 0.8

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the raster; UserError when no lane is left."""
        frame = Frame.of(obstacles, self.facade_deg)
        low, high = frame.aside[0] + self.margin_m, frame.aside[1] - self.margin_m
        top = frame.up[1] if self.to_height_m is None else self.to_height_m
        if not (low < high and self.from_height_m <= top):
            raise UserError(
                f"margin_m {self.margin_m} and heights {self.from_height_m} to {top} m leave no lane on a facade "
                f"{frame.aside[1] - frame.aside[0]:.2f} m wide"
            )
        between = (top - self.from_height_m) / self.lane_spacing_m
        if between > MOST_LANES:
            raise UserError(
                f"lane_spacing_m {self.lane_spacing_m:g}: gives {between:.3g} lanes, at most {MOST_LANES:,} are planned"
            )
        lanes = np.linspace(self.from_height_m, top, int(np.ceil(between)) + 1)
        ahead = frame.ahead[1] + self.distance_m
        points = []
        for i, height in enumerate(lanes):
            for aside in (low, high) if i % 2 == 0 else (high, low):
                points.append(frame.point(ahead, aside, float(height)))
        yaws = np.full(len(points), np.radians(self.facade_deg) + np.pi)
        return _stopping(self, np.array(points), yaws)


@dataclass(frozen=True)
class GirderFollow:
    """Path along one side of a long structure and back, facing it, with the heading turned look_ahead_deg forwards.

    The structure runs along the bearing along_deg; the vehicle keeps distance_m from its side at height_m and flies
    overrun_m beyond its ends (negative: stops short of them). stretch_m restricts the path to a part: from and to, in
    metres along the bearing from the structure's centre.
    The whole path takes duration_s, or is flown at speed_m_s (default 0.8).
    """

    along_deg: Angle = 0.0
    side: Literal["left", "right"] = "right"
    distance_m: Annotated[float, Gt(0)] = 2.0
    height_m: Annotated[float, Gt(0)] = 2.0
    look_ahead_deg: Annotated[float, Interval(ge=-80, le=90)] = 20.0
    overrun_m: float = 0.0
    stretch_m: tuple[float, float] | None = None
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.8
    usual_speed_m_s: ClassVar[float] = 0.8

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the path in both directions; UserError when overrun_m or stretch_m leaves no path."""
        frame = Frame.of(obstacles, self.along_deg)
        start, end = _run(frame, self.overrun_m, self.stretch_m)
        left = self.side == "left"
        aside = frame.aside[1] + self.distance_m if left else frame.aside[0] - self.distance_m
        points = [frame.point(ahead, aside, self.height_m) for ahead in (start, end, end, start)]
        inward = np.radians(self.along_deg) + (-1.0 if left else 1.0) * np.pi / 2
        turn = np.radians(self.look_ahead_deg) * (1.0 if left else -1.0)
        yaws = inward + np.array([turn, turn, -turn, -turn])
        return _stopping(self, np.array(points), yaws)


@dataclass(frozen=True)
class UndersidePass:
    """Path underneath a bridge, along it, facing forwards; pitch the camera mount upwards to see the deck.

    The bridge runs along the bearing along_deg; the lanes are offsets_m to the left of its axis, at height_m, and
    extend overrun_m beyond its ends (negative: stop short of them). stretch_m restricts the path to a part, such as one
    span between two piers: from and to, in metres along the bearing from the bridge's centre.
    The whole path takes duration_s, or is flown at speed_m_s (default 0.8).
    """

    along_deg: Angle = 0.0
    offsets_m: tuple[float, ...] = (0.0,)
    height_m: Annotated[float, Gt(0)] = 2.0
    overrun_m: float = 0.0
    stretch_m: tuple[float, float] | None = None
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.8
    usual_speed_m_s: ClassVar[float] = 0.8

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the lanes in alternating directions; UserError when overrun_m or stretch_m leaves no path."""
        if not self.offsets_m:
            raise UserError("offsets_m is empty; give the offset of at least one lane")
        frame = Frame.of(obstacles, self.along_deg)
        start, end = _run(frame, self.overrun_m, self.stretch_m)
        middle = (frame.aside[0] + frame.aside[1]) / 2
        points, yaws = [], []
        for i, offset in enumerate(self.offsets_m):
            for ahead in (start, end) if i % 2 == 0 else (end, start):
                points.append(frame.point(ahead, middle + offset, self.height_m))
                yaws.append(np.radians(self.along_deg) + np.pi * (i % 2))
        return _stopping(self, np.array(points), np.array(yaws))


def _stopping(
    path: "FacadeRaster | GirderFollow | UndersidePass | Waypoints", points: Array, yaws: Array, dwell_s: float = 0.0
) -> Planned:
    """Plan through points (k, 3) in metres, yaws (k,) in rad, at rest at each, with the path's duration or speed."""

    def through(speed_m_s: float) -> Array:
        return np.column_stack(stop_and_go(points, yaws, speed_m_s, path.acceleration_m_s2, YAW_RATE_RAD_S, dwell_s))

    table = timed_rows(path, through, _length(points))
    return planned(table[:, :3], table[:, 3])


def _length(points: Array) -> float:
    return math.fsum(exact.length(np.diff(points, axis=0)).tolist())


def _run(frame: Frame, overrun_m: float, stretch_m: tuple[float, float] | None) -> tuple[float, float]:
    if stretch_m is not None:
        if overrun_m:
            raise UserError(f"overrun_m {overrun_m:g} has no effect: stretch_m names both ends; leave one out")
        middle = (frame.ahead[0] + frame.ahead[1]) / 2
        if stretch_m[0] >= stretch_m[1]:
            raise UserError(f"stretch_m {stretch_m} must be increasing")
        return middle + stretch_m[0], middle + stretch_m[1]
    start, end = frame.ahead[0] - overrun_m, frame.ahead[1] + overrun_m
    if start >= end:
        raise UserError(
            f"overrun_m {overrun_m} leaves no path along a structure {frame.ahead[1] - frame.ahead[0]:.2f} m long"
        )
    return start, end


@dataclass(frozen=True)
class Waypoints:
    """Straight lines through the points of a CSV file with the columns x_m, y_m, z_m, yaw_deg.

    With stop the vehicle rests at each point for at least dwell_s; without, it cuts the corners.
    The whole path takes duration_s, or is flown at speed_m_s (default 0.5).
    """

    file: str = "waypoints.csv"
    stop: bool = True
    dwell_s: Annotated[float, Ge(0)] = 0.0
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.5
    usual_speed_m_s: ClassVar[float] = 0.5

    def __post_init__(self) -> None:
        refuse_idle(self, {"dwell_s": ("stop",)})

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan through the points; UserError naming the file and line."""
        table = read_waypoints(Path(self.file))
        points, yaws = table[:, :3], np.radians(table[:, 3])
        if self.stop:
            return _stopping(self, points, yaws, self.dwell_s)

        def past(speed_m_s: float) -> Array:
            return np.column_stack(fly_through(points, yaws, speed_m_s, self.acceleration_m_s2, YAW_RATE_RAD_S))

        table = timed_rows(self, past, _length(points))
        return planned(table[:, :3], table[:, 3])


def read_waypoints(path: Path) -> Array:
    """Table (k, 4) of a waypoint file: x, y, z in metres, yaw in degrees; UserError naming the file and line."""
    rows: Array = numbers(path, ["x_m", "y_m", "z_m", "yaw_deg"], SETTINGS)
    bad = ~(np.abs(rows).max(axis=1, initial=0.0) <= LARGEST_COORDINATE_M)
    if bad.any():
        line = line_of_row(path, int(np.argmax(bad)))
        raise UserError(f"{path}: line {line} has a value that is not finite or beyond {LARGEST_COORDINATE_M:g}")
    if len(rows) < 2:
        raise UserError(f"{path}: needs at least two waypoints")
    return rows
