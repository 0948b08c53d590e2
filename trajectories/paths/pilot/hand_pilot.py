"""The path `hand-pilot`: a simulated pilot flies around a structure with a gamepad and keeps the camera on it."""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.pilot.gamepad import Assist, Gamepad, Wander
from uavbench.trajectories.paths.reference import Guidance, VehicleState
from uavbench.trajectories.paths.timing import check_flight_time
from uavbench.trajectories.pose import Angle, Array
from uavbench.trajectories.vehicle.quadrotor import STEP_S

WARM_UP_S = 4.0
DECISION_S = (0.25, 0.50)
"""Time between two decisions of the pilot: humans correct intermittently, 2 to 4 times a second (Craik 1947)."""
NOTICED = np.array([0.03, 0.0, 0.02, np.radians(2.5)])
"""Dead band of the pilot: uncorrected errors of range (m), sideways (none), height (m) and heading (rad)."""
EAGERNESS_1_S = np.array([0.6, 0.0, 0.7, 0.9])
"""Gain of the pilot: commanded speed per error, 1/s."""
NEAREST_M = 0.01
"""Least distance from the centre for which the pilot turns, m: an estimate may be as wrong as to lie on the centre."""
CLUMSINESS = 0.10
"""Relative standard deviation of a stick deflection from the intended one; an assumption."""


@dataclass(frozen=True)
class HandPilot:
    """A simulated pilot flies around the structure and corrects errors with delay and imprecision.

    The horizontal distance to the structure's centre stays in range_m and the height in height_m, both varying slowly;
    the flight circles at about speed_m_s from the bearing start_deg (seen from the structure, counter-clockwise from
    x). The height is limited such that the whole structure stays within view_half_angle_deg above and below the
    camera's axis. reaction_s is the pilot's delay. wander_m and wander_deg are the standard deviations of the vehicle's
    position and heading hold, as with a flow deck.
    """

    duration_s: Annotated[float, Gt(0)] = 40.0
    range_m: tuple[float, float] = (1.05, 1.55)
    height_m: tuple[float, float] = (0.38, 0.90)
    speed_m_s: Annotated[float, Ge(0)] = 0.16
    start_deg: Angle = 30.0
    direction: Literal["counter-clockwise", "clockwise"] = "counter-clockwise"
    view_half_angle_deg: Annotated[float, Interval(gt=0, lt=80)] = 21.0
    reaction_s: Annotated[float, Ge(0)] = 0.2
    wander_m: Annotated[float, Ge(0)] = 0.008
    wander_deg: Annotated[float, Ge(0)] = 0.7
    pad: Gamepad = field(default_factory=Gamepad)

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Guidance:
        """Guidance by the pilot; UserError when the structure cannot be kept in view at this range."""
        return Pilot(self, Stage.of(self, obstacles, mount), rng)


@dataclass(frozen=True)
class Stage:
    """The region that the pilot flies in: around a centre (x, y), with a range of heights at each distance."""

    centre: tuple[float, float]
    low_m: float
    high_m: float
    reach_m: float
    slope_down: float
    slope_up: float
    range_m: tuple[float, float]
    height_m: tuple[float, float]

    @classmethod
    def of(cls, path: HandPilot, obstacles: ObstacleMesh, mount: Mount) -> "Stage":
        """Stage around the obstacles' centre; UserError naming the setting that leaves no room."""
        low, high = obstacles.bounds
        reach = float(exact.length(high[:2] - low[:2]) / 2)
        stage = cls(
            (float(obstacles.centre[0]), float(obstacles.centre[1])),
            float(low[2]),
            float(high[2]),
            reach,
            math.tan(math.radians(path.view_half_angle_deg - mount.pitch_deg)),
            math.tan(math.radians(path.view_half_angle_deg + mount.pitch_deg)),
            path.range_m,
            path.height_m,
        )
        if not reach < path.range_m[0] <= path.range_m[1] or not 0 < path.height_m[0] <= path.height_m[1]:
            raise UserError(
                f"range_m {path.range_m} must be increasing and begin beyond the structure's corners "
                f"({reach:.2f} m from its centre), height_m {path.height_m} must be increasing from above 0"
            )
        lowest, highest = stage.heights(path.range_m[1])
        if not lowest <= highest:
            raise UserError(
                f"from {path.range_m[1]} m the structure, {low[2]:.2f} to {high[2]:.2f} m high, does "
                f"not fit into {path.view_half_angle_deg} degrees above and below the camera's axis at heights "
                f"{path.height_m} m; fly further away (range_m), at other heights (height_m) or tilt the mount"
            )
        return stage

    def heights(self, distance_m: float) -> tuple[float, float]:
        """Lowest and highest height (m) at a distance from which the whole structure is in view."""
        near = distance_m - self.reach_m
        lowest = max(self.height_m[0], self.high_m - near * self.slope_up)
        return lowest, min(self.height_m[1], self.low_m + near * self.slope_down)

    def place(self, closeness: float, loftiness: float) -> tuple[float, float]:
        """Distance and height (m) for two preferences in 0..1, such that the whole structure is in view."""
        nearest, furthest = self.range_m
        for tried in np.linspace(nearest, furthest, 41).tolist():  # The nearest distance at which all of it is in view.
            lowest, highest = self.heights(tried)
            if lowest <= highest:
                nearest = tried
                break
        distance = furthest - closeness * (furthest - nearest)
        lowest, highest = self.heights(distance)
        return distance, lowest + loftiness * (highest - lowest)


class Pilot:
    """State of the pilot: delayed observations, decisions at intervals, stick motion."""

    def __init__(self, path: HandPilot, stage: Stage, rng: np.random.Generator) -> None:
        self.warm_up = round(WARM_UP_S / STEP_S)
        check_flight_time(path.duration_s)
        self.steps = round(path.duration_s / STEP_S) + 1
        self._path, self._stage, self._rng = path, stage, rng
        self._sign = 1.0 if path.direction == "counter-clockwise" else -1.0
        self._signals = [SlowSignal(rng) for _ in range(3)]
        bearing = np.radians(path.start_deg) - self._sign * path.speed_m_s * WARM_UP_S / np.mean(path.range_m)
        distance, height = self._place(-WARM_UP_S)
        start = np.array([*(stage.centre + distance * np.array([math.cos(bearing), math.sin(bearing)])), height])
        wander = Wander(path.wander_m, np.radians(path.wander_deg), rng)
        self._assist = Assist(start, bearing + np.pi, wander, self.warm_up + self.steps)
        self._memory: deque[VehicleState] = deque()
        self._stick_input, self._target = np.zeros(4), np.zeros(4)
        self._decide_at = -WARM_UP_S

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        """Reference rows of the next steps, from the pilot's stick input."""
        if state is None:
            return np.tile(self._assist.now(), (count, 1))
        now = first * STEP_S
        self._memory.append(state)
        late = self._memory[0]
        if len(self._memory) > round(self._path.reaction_s / (count * STEP_S)):
            self._memory.popleft()
        if now >= self._decide_at:
            self._target = self._decide(now, late)
            self._decide_at = now + self._rng.uniform(*DECISION_S)
        way = self._path.pad.thumb_rate_1_s * count * STEP_S
        self._stick_input += np.minimum(np.maximum(self._target - self._stick_input, -way), way)
        held = self._stick_input + self._path.pad.tremor * self._rng.standard_normal(4)
        return self._assist.rows(self._path.pad.command(held), count)

    def _place(self, now_s: float) -> tuple[float, float]:
        return self._stage.place(self._signals[0].at(now_s), self._signals[1].at(now_s))

    def _decide(self, now_s: float, late: VehicleState) -> Array:
        """Stick deflections (4,) that correct the state observed with delay."""
        to_centre = np.array(self._stage.centre) - late.position_m[:2]
        distance = float(exact.length(to_centre))
        desired_distance, desired_height = self._place(now_s)
        turn = math.atan2(to_centre[1], to_centre[0]) - late.yaw_rad
        error = np.array(
            [
                distance - desired_distance,
                0.0,
                desired_height - late.position_m[2],
                math.atan2(math.sin(turn), math.cos(turn)),
            ]
        )
        command = EAGERNESS_1_S * np.where(np.abs(error) > NOTICED, error, 0.0)
        sideways_m_s = self._sign * self._path.speed_m_s * (0.4 + 1.2 * self._signals[2].at(now_s))
        command[1] -= sideways_m_s  # Facing the structure, counter-clockwise is to the right.
        command[3] += sideways_m_s / max(distance, NEAREST_M)
        return np.asarray(
            np.clip(self._path.pad.deflection(command) * (1 + CLUMSINESS * self._rng.standard_normal(4)), -1.0, 1.0)
        )


class SlowSignal:
    """A slow random signal in 0..1: four sine waves of random period and phase."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rates = 2 * np.pi / rng.uniform(12.0, 45.0, 4)
        self._phases = rng.uniform(0.0, 2 * np.pi, 4)

    def at(self, now_s: float) -> float:
        """The signal at a time."""
        waves = float(exact.sin(self._rates * now_s + self._phases).sum())
        return 0.5 + 0.5 * math.tanh(0.8 * waves)
