"""Position servo of a joint: a second-order system with limits, in steps of a fixed length."""

import math
from typing import NamedTuple

from uavbench.trajectories.gimbal.axes import GimbalAxis

TERMS = 60
"""Terms of the exponential series: rounding error alone for steps of 2 ms at the highest frequency and damping."""


class Transition(NamedTuple):
    """Entries of the transition matrix [[a, b], [c, d]] of a step, for the state (angle, rate / w)."""

    a: float
    b: float
    c: float
    d: float


class Servo:
    """A joint at rest at an angle (rad), to be advanced in steps of step_s; angle and rate are its state.

    Exact between steps for a command that changes linearly, by the matrix exponential.
    """

    def __init__(self, axis: GimbalAxis, step_s: float, angle_rad: float) -> None:
        self._w, self._damping, self._step_s = 2 * math.pi * axis.natural_frequency_hz, axis.damping, step_s
        self._least, self._greatest = math.radians(axis.least_deg), math.radians(axis.greatest_deg)
        self._greatest_rate = math.radians(axis.greatest_rate_deg_s)
        self._step = _exponential(self._w * step_s, axis.damping)
        self.angle, self.rate = self._within(angle_rad), 0.0
        self._command = self.angle

    def advance(self, command_rad: float) -> float:
        """Angle (rad) after a step in which the command changes linearly to this one, limited to the stops.

        A command that exceeds half a turn from the present angle is taken to be the same attitude a turn nearer.
        """
        turns = round((self.angle - command_rad) / (2 * math.pi))
        command = self._within(command_rad + 2 * math.pi * turns)
        step, slope = self._step, (command - self._command) / self._step_s
        lag = 2 * self._damping * slope / self._w
        # about the command that changes linearly, the lag is at rest
        error, change = self.angle - self._command + lag, (self.rate - slope) / self._w
        angle = command - lag + step.a * error + step.b * change
        rate = slope + self._w * (step.c * error + step.d * change)
        most = self._greatest_rate * self._step_s
        angle = min(max(angle, self.angle - most), self.angle + most)
        self.rate = min(max(rate, -self._greatest_rate), self._greatest_rate)
        self.angle, self._command = self._within(angle), command
        if self.angle != angle:
            self.rate = 0.0
        return self.angle

    def _within(self, angle_rad: float) -> float:
        return min(max(angle_rad, self._least), self._greatest)


def _exponential(x: float, damping: float) -> Transition:
    """Exponential of A x for A = [[0, 1], [-1, -2 damping]], the servo in units of 1 / w."""
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    p, q, r, s = a, b, c, d
    for k in range(1, TERMS):
        p, q, r, s = r * x / k, s * x / k, (-p - 2 * damping * r) * x / k, (-q - 2 * damping * s) * x / k
        a, b, c, d = a + p, b + q, c + r, d + s
    return Transition(a, b, c, d)
