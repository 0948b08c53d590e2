"""Paths around or in front of a structure: orbit, pier spiral, approach, hover, figure-8."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.reference import Planned, planned
from uavbench.trajectories.paths.smooth_motion import progress
from uavbench.trajectories.paths.timing import check_flight_time, timed_rows
from uavbench.trajectories.pose import Angle, Array
from uavbench.trajectories.vehicle.quadrotor import STEP_S

Direction = Literal["counter-clockwise", "clockwise"]


def reach(obstacles: ObstacleMesh) -> float:
    """Horizontal distance from the centre of the bounds to their corners, metres."""
    low, high = obstacles.bounds
    return float(exact.length(high[:2] - low[:2]) / 2)


def bearing(degrees: float) -> Array:
    """Unit vector (2,) of a bearing, counter-clockwise from the world's x axis."""
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


def facing(positions: Array, target: Array) -> Array:
    """Unwrapped yaws (n,) in rad that face a target (2,) from positions (n, 3), metres; UserError straight above it."""
    to = target - positions[:, :2]
    if np.linalg.norm(to, axis=1).min() < 1e-3:
        raise UserError("the path passes directly above its target, where the heading is undefined; move it sideways")
    return np.unwrap(exact.arctan2(to[:, 1], to[:, 0]))


@dataclass(frozen=True)
class Orbit:
    """Circular orbit around the structure's centre at constant height, facing it.

    The circle lies distance_m outside the corners of the structure's bounds and begins at start_deg. It takes
    duration_s, or is flown at speed_m_s (default 0.3), slower where the centripetal acceleration would exceed
    acceleration_m_s2. It begins and ends at rest.
    """

    distance_m: Annotated[float, Gt(0)] = 1.0
    height_m: Annotated[float, Gt(0)] = 0.5
    turns: Annotated[float, Gt(0)] = 1.0
    start_deg: Angle = 0.0
    direction: Direction = "counter-clockwise"
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.5
    usual_speed_m_s: ClassVar[float] = 0.3

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the orbit."""
        radius = reach(obstacles) + self.distance_m
        return _helix(self, obstacles.centre[:2], radius, 2 * np.pi * self.turns, self.height_m, self.height_m)


@dataclass(frozen=True)
class PierSpiral:
    """Helix around a pier from one height to another, facing its axis.

    The axis is at centre_m (x, y), by default the centre of the structure; radius_m is from the axis; rise_m is per
    turn. It takes duration_s, or is flown at speed_m_s (default 0.8), slower where the centripetal acceleration would
    exceed acceleration_m_s2.
    """

    radius_m: Annotated[float, Gt(0)] = 3.0
    from_height_m: Annotated[float, Gt(0)] = 1.0
    to_height_m: Annotated[float, Gt(0)] = 6.0
    rise_m: Annotated[float, Gt(0)] = 1.5
    centre_m: tuple[float, float] | None = None
    start_deg: Angle = 0.0
    direction: Direction = "counter-clockwise"
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.5
    usual_speed_m_s: ClassVar[float] = 0.8

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the helix."""
        centre = obstacles.centre[:2] if self.centre_m is None else np.array(self.centre_m)
        angle = 2 * np.pi * max(abs(self.to_height_m - self.from_height_m) / self.rise_m, 0.25)
        return _helix(self, centre, self.radius_m, angle, self.from_height_m, self.to_height_m)


def _helix(path: Orbit | PierSpiral, centre: Array, radius: float, angle: float, low: float, high: float) -> Planned:
    """Plan of a helix through `angle` radians around a vertical axis."""
    per_radian = math.hypot(radius, (high - low) / angle)
    # Centripetal acceleration is radius (speed / per_radian)^2; half of the limit is left for acceleration.
    fastest = per_radian * float(np.sqrt(0.5 * path.acceleration_m_s2 / radius))

    def way_at(speed_m_s: float) -> Array:
        return progress(angle * per_radian, min(speed_m_s, fastest), 0.5 * path.acceleration_m_s2) / per_radian

    way = timed_rows(path, way_at, angle * per_radian)
    sign = 1.0 if path.direction == "counter-clockwise" else -1.0
    around = np.radians(path.start_deg) + sign * way
    positions = np.column_stack(
        [
            centre[0] + radius * exact.cos(around),
            centre[1] + radius * exact.sin(around),
            low + (high - low) * way / angle,
        ]
    )
    return planned(positions, around + np.pi)


@dataclass(frozen=True)
class Approach:
    """Straight approach towards the structure and back, facing it, `cycles` times.

    Distances are horizontal, from the corners of the structure's bounds, along the bearing from_deg. The path takes
    duration_s, or is flown at speed_m_s (default 0.3).
    """

    far_m: Annotated[float, Gt(0)] = 3.0
    near_m: Annotated[float, Gt(0)] = 0.8
    height_m: Annotated[float, Gt(0)] = 0.5
    from_deg: Angle = 30.0
    cycles: Annotated[int, Ge(1)] = 1
    speed_m_s: Annotated[float, Gt(0)] | None = None
    duration_s: Annotated[float, Gt(0)] | None = None
    acceleration_m_s2: Annotated[float, Gt(0)] = 0.5
    usual_speed_m_s: ClassVar[float] = 0.3

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the approach and retreat."""
        if self.near_m >= self.far_m:
            raise UserError(f"near_m {self.near_m} must be less than far_m {self.far_m}")
        length = self.far_m - self.near_m

        def travelled_at(speed_m_s: float) -> Array:
            way = progress(length, speed_m_s, self.acceleration_m_s2)
            there_and_back = np.concatenate([way, way[::-1][1:]])
            check_flight_time(len(there_and_back) * self.cycles * STEP_S)
            return np.concatenate([there_and_back, *[there_and_back[1:]] * (self.cycles - 1)])

        travelled = timed_rows(self, travelled_at, 2 * self.cycles * length)
        distance = reach(obstacles) + self.far_m - travelled
        xy = obstacles.centre[:2] + distance[:, None] * bearing(self.from_deg)
        positions = np.column_stack([xy, np.full(len(xy), self.height_m)])
        return planned(positions, facing(positions, obstacles.centre[:2]))


@dataclass(frozen=True)
class Hover:
    """Hover in front of the structure, facing it; distance_m is measured from the corners of its bounds."""

    duration_s: Annotated[float, Gt(0)] = 20.0
    distance_m: Annotated[float, Gt(0)] = 1.0
    height_m: Annotated[float, Gt(0)] = 0.5
    from_deg: Angle = 30.0

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the hover."""
        xy = obstacles.centre[:2] + (reach(obstacles) + self.distance_m) * bearing(self.from_deg)
        check_flight_time(self.duration_s)
        steps = round(self.duration_s / STEP_S) + 1
        positions = np.tile([*xy, self.height_m], (steps, 1))
        return planned(positions, facing(positions, obstacles.centre[:2]))


@dataclass(frozen=True)
class FigureEight:
    """Horizontal figure-8 (lemniscate of Gerono) in front of the structure, facing it, with a period of period_s.

    Its centre is distance_m outside the corners of the structure's bounds; width_m is its extent across the view,
    depth_m along it and rise_m upwards. The vehicle accelerates over one period, flies `loops` periods at full rate and
    decelerates over one.
    """

    period_s: Annotated[float, Gt(0)] = 6.0
    loops: Annotated[int, Ge(1)] = 3
    width_m: Annotated[float, Gt(0)] = 2.0
    depth_m: Annotated[float, Ge(0)] = 1.0
    rise_m: Annotated[float, Ge(0)] = 0.0
    distance_m: Annotated[float, Gt(0)] = 1.5
    height_m: Annotated[float, Gt(0)] = 0.7
    from_deg: Angle = 30.0

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Planned:
        """Plan of the figure-8."""
        rate = 2 * np.pi / self.period_s
        # Windows of 1, 1/2, 1/4 and 1/8 times 8/15 of a period: it accelerates over one, half a loop.
        phase = progress(2 * np.pi * (self.loops + 1), rate, rate / (self.period_s * 8 / 15))
        forward = bearing(self.from_deg)
        side = np.array([-forward[1], forward[0]])
        middle = obstacles.centre[:2] + (reach(obstacles) + self.distance_m) * forward
        across, along = self.width_m / 2 * exact.sin(phase), self.depth_m / 2 * exact.sin(2 * phase)
        xy = middle + across[:, None] * side + along[:, None] * forward
        positions = np.column_stack([xy, self.height_m + self.rise_m / 2 * exact.sin(phase)])
        return planned(positions, facing(positions, obstacles.centre[:2]))
