"""Timing of a planned path: by speed, or by duration."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.vehicle.quadrotor import STEP_S

FASTER = 1.05
"""Ratio of successive speeds in the search for the fastest plan."""
LONGEST_FLIGHT_S = 10_000.0
"""Longest flight, in which a 200 Hz IMU has as many rows as a table may have (`files.limits.MOST_ROWS`)."""


class TooLongError(UserError):
    """A flight would take too long."""


def check_flight_time(seconds: float) -> None:
    """TooLongError for a flight that is too long, before memory is allocated for its steps."""
    if not seconds <= LONGEST_FLIGHT_S:
        raise TooLongError(
            f"the flight would take {seconds:.4g} s; at most {LONGEST_FLIGHT_S:,.0f} s are allowed; split it"
        )


class TimedPath(Protocol):
    """A path with an optional duration or speed, and a default speed."""

    @property
    def speed_m_s(self) -> float | None:
        """Requested maximum speed."""
        ...

    @property
    def duration_s(self) -> float | None:
        """Requested duration, from rest to rest."""
        ...

    @property
    def acceleration_m_s2(self) -> float:
        """Maximum acceleration."""
        ...

    @property
    def usual_speed_m_s(self) -> float:
        """Default speed."""
        ...


def requested_speed(path: object) -> float | None:
    """Requested or default speed of a path; None when a duration is given, or the path has no speed."""
    speed = getattr(path, "speed_m_s", None)
    if speed is None and getattr(path, "duration_s", None) is None:
        speed = getattr(path, "usual_speed_m_s", None)
    return None if speed is None else float(speed)


def timed_rows(path: TimedPath, rows_at: Callable[[float], Array], length_m: float) -> Array:
    """Rows (n, ...) of a path, one per control step, at its speed or of its duration; rows_at(speed) plans them.

    UserError when both are given, or when the duration is infeasible within the acceleration limit; TooLongError names
    the numbers that make a flight too long.
    """
    try:
        return _timed(path, rows_at, length_m)
    except TooLongError as error:
        speed = path.usual_speed_m_s if path.speed_m_s is None else path.speed_m_s
        by = f"speed_m_s {speed:g}" if path.duration_s is None else f"duration_s {path.duration_s:g}"
        limit = f"acceleration_m_s2 {path.acceleration_m_s2:g}"
        raise TooLongError(f"{by} and {limit}, for {length_m:.4g} m: {error}") from None


def _timed(path: TimedPath, rows_at: Callable[[float], Array], length_m: float) -> Array:
    if path.duration_s is None:
        return rows_at(path.usual_speed_m_s if path.speed_m_s is None else path.speed_m_s)
    if path.speed_m_s is not None:
        raise UserError("give duration_s or speed_m_s, not both")
    check_flight_time(path.duration_s)
    wanted = round(path.duration_s / STEP_S) + 1
    past_optimum = (path.acceleration_m_s2 * max(length_m, 1e-3)) ** 0.5
    average = min(max(length_m, 1e-3) / path.duration_s, past_optimum)
    speed = slower = average  # a lower bound: a path from rest to rest takes longer
    rows = rows_at(speed)
    least = len(rows)
    while len(rows) > wanted:
        slower, speed = speed, FASTER * speed
        rows = rows_at(speed)
        if len(rows) >= least:  # past the optimum
            slower = average
            speed = _fastest(rows_at, average)
            rows = rows_at(speed)
            if len(rows) <= wanted:
                break
            least_s = math.ceil(round(10 * (len(rows) - 1) * STEP_S, 6)) / 10  # rounded up: it can be flown
            raise UserError(
                f"duration_s {path.duration_s:g}: {length_m:.2f} m from rest to rest take "
                f"{least_s:.1f} s or more at {path.acceleration_m_s2:g} m/s^2; raise "
                "acceleration_m_s2 or duration_s"
            )
        least = len(rows)
    for _ in range(20):
        middle = (slower + speed) / 2
        tried = rows_at(middle)
        if len(tried) > wanted:
            slower = middle
        else:
            speed, rows = middle, tried
    rest = wanted - len(rows)
    return np.concatenate([rows, np.repeat(rows[-1:], rest, axis=0)])


def _fastest(rows_at: Callable[[float], Array], speed: float) -> float:
    """Speed of the fastest plan: the duration decreases with the speed up to the optimum, and then increases.

    speed: start of the search; the speed that the acceleration reaches at half the path is past the optimum.
    """
    fewest = len(rows_at(speed))
    for step in (0.5, 1 / FASTER, FASTER):
        while (tried := len(rows_at(step * speed))) < fewest:
            fewest, speed = tried, step * speed
    return speed
