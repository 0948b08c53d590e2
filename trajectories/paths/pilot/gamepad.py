"""A gamepad, and the velocity assist mode that turns its stick input into a reference."""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.paths.reference import fill_rates
from uavbench.trajectories.pose import Array
from uavbench.trajectories.vehicle.geometric_control import REFERENCE_COLUMNS
from uavbench.trajectories.vehicle.quadrotor import STEP_S

VELOCITY_BANDWIDTH_RAD_S = 5.0
YAW_BANDWIDTH_RAD_S = 8.0
"""Bandwidth of the assist mode's response to a stick (second order, critically damped)."""


@dataclass(frozen=True)
class Gamepad:
    """A gamepad in velocity assist mode: forward, left and up speed and yaw rate, one stick axis each.

    Inside dead_zone an axis counts as centred; beyond it the response is exponential: e x^3 + (1 - e) x with e = expo.
    thumb_rate_1_s is the rate limit of a thumb, in full deflections per second. Full deflection gives top_speed_m_s,
    top_climb_m_s or top_yaw_rate_deg_s.
    """

    dead_zone: Annotated[float, Interval(ge=0, lt=0.5)] = 0.1
    expo: Annotated[float, Interval(ge=0, le=1)] = 0.4
    thumb_rate_1_s: Annotated[float, Gt(0)] = 3.0
    tremor: Annotated[float, Ge(0)] = 0.01
    top_speed_m_s: Annotated[float, Gt(0)] = 0.6
    top_climb_m_s: Annotated[float, Gt(0)] = 0.4
    top_yaw_rate_deg_s: Annotated[float, Gt(0)] = 70.0

    @cached_property
    def tops(self) -> Array:
        """Commands (4,) at full deflection: m/s forward, left, up; rad/s."""
        return np.array(
            [self.top_speed_m_s, self.top_speed_m_s, self.top_climb_m_s, np.radians(self.top_yaw_rate_deg_s)]
        )

    def command(self, stick_input: Array) -> Array:
        """Commands (4,) of stick deflections (4,) in -1..1."""
        command = np.empty(4)
        _bend(stick_input, self.dead_zone, self.expo, self.tops, command)
        return command

    def deflection(self, command: Array) -> Array:
        """Stick deflections (4,) that give a command (4,), within -1..1: the inverse of `command`."""
        share = np.clip(np.abs(command) / self.tops, 0.0, 1.0)
        beyond = share.copy()
        for _ in range(20):  # Newton on e x^3 + (1 - e) x = share, monotone for e in 0..1.
            slope = 3 * self.expo * beyond**2 + (1 - self.expo)
            beyond -= (self.expo * (beyond * beyond * beyond) + (1 - self.expo) * beyond - share) / np.maximum(
                slope, 1e-6
            )
        bare = np.where(share > 0, self.dead_zone + (1 - self.dead_zone) * np.clip(beyond, 0.0, 1.0), 0.0)
        return np.asarray(np.sign(command) * bare)


class Wander:
    """Error of position and heading hold: for each of x, y, z (m) and yaw (rad) a sum of five random sine waves."""

    PERIODS_S = (1.5, 8.0)

    def __init__(self, sigma_m: float, sigma_rad: float, rng: np.random.Generator) -> None:
        self._rates = 2 * np.pi / rng.uniform(*self.PERIODS_S, (5, 4))
        self._phases = rng.uniform(0.0, 2 * np.pi, (5, 4))
        self._amplitudes = np.array([sigma_m, sigma_m, sigma_m, sigma_rad]) * np.sqrt(2 / 5)

    def at(self, times_s: Array) -> tuple[Array, Array, Array, Array]:
        """The error (n, 4) at times (n,) and its first three derivatives."""
        angle = self._rates * times_s[:, None, None] + self._phases
        sine, cosine, rates = exact.sin(angle), exact.cos(angle), self._rates
        waves = (sine, rates * cosine, -(rates * rates) * sine, -(rates * rates * rates) * cosine)
        error, first, second, third = (self._amplitudes * wave.sum(axis=1) for wave in waves)
        return error, first, second, third


class Assist:
    """Velocity assist: holds position and heading with an error, and moves them by the stick input."""

    def __init__(self, position_m: Array, yaw_rad: float, wander: Wander, steps: int) -> None:
        # position 0:3, velocity 3:6, acceleration 6:9, yaw 9, yaw rate 10, yaw acceleration 11
        self._state = np.zeros(12)
        self._state[0:3], self._state[9] = position_m, yaw_rad
        # of each step its error, and the first three derivatives
        self._wander = np.stack(wander.at(np.arange(steps, dtype=np.float64) * STEP_S), axis=1)
        self._step = 0

    def now(self) -> Array:
        """Current reference row (17,), at rest."""
        row = np.zeros(REFERENCE_COLUMNS)
        error = self._wander[self._step, 0]
        row[0:3], row[9] = self._state[0:3] + error[:3], self._state[9] + error[3]
        return row

    def rows(self, command: Array, count: int) -> Array:
        """Reference rows (count, 17) of the next steps under one command (4,): m/s forward, left, up; rad/s."""
        rows = np.zeros((count, REFERENCE_COLUMNS))
        _follow(self._state, command, self._wander[self._step : self._step + count], rows)
        self._step += count
        return rows


@compiled("f1 f0 f0 f1 f1!", allocates=False)
def _bend(stick_input: Array, dead_zone: float, expo: float, tops: Array, command: Array) -> None:
    """Commands of a gamepad into command (4,)."""
    for i in range(4):
        x = stick_input[i]
        beyond = np.minimum(np.maximum((abs(x) - dead_zone) / (1 - dead_zone), 0.0), 1.0)
        bent = expo * (beyond * beyond * beyond) + (1 - expo) * beyond
        command[i] = np.sign(x) * bent * tops[i]


@compiled("f1! f1 f3 f2!")
def _follow(state: Array, command: Array, wander: Array, rows: Array) -> None:
    """Second-order lags from command to velocity and yaw rate, integrated exactly for a constant jerk per step.

    wander (n, 4, 4): error of position and yaw that is added to rows (n, 17), and its first three derivatives.
    """
    jerks, yaw_rates = np.empty((len(rows), 3)), np.empty(len(rows))
    w, u, h = VELOCITY_BANDWIDTH_RAD_S, YAW_BANDWIDTH_RAD_S, STEP_S
    for k in range(rows.shape[0]):
        c, s = cos(state[9]), sin(state[9])
        wanted = (c * command[0] - s * command[1], s * command[0] + c * command[1], command[2])
        rows[k, :10] = state[:10]
        yaw_rates[k] = state[10]
        for i in range(3):
            x, v, a = state[i], state[3 + i], state[6 + i]
            jerk = w * w * (wanted[i] - v) - 2 * w * a
            jerks[k, i] = jerk
            state[i] = x + h * v + h * h / 2 * a + h * h * h / 6 * jerk
            state[3 + i] = v + h * a + h * h / 2 * jerk
            state[6 + i] = a + h * jerk
        yaw_jerk = u * u * (command[3] - state[10]) - 2 * u * state[11]
        state[9] += h * state[10] + h * h / 2 * state[11] + h * h * h / 6 * yaw_jerk
        state[10] += h * state[11] + h * h / 2 * yaw_jerk
        state[11] += h * yaw_jerk
        for i in range(3):
            rows[k, i] += wander[k, 0, i]
            rows[k, 3 + i] += wander[k, 1, i]
            rows[k, 6 + i] += wander[k, 2, i]
            jerks[k, i] += wander[k, 3, i]
        rows[k, 9] += wander[k, 0, 3]
        yaw_rates[k] += wander[k, 1, 3]
    fill_rates(rows, jerks, yaw_rates)
