"""Smooth motions with bounded speed and acceleration, one sample per control step.

A motion of piecewise constant velocity is filtered by moving averages. An average never exceeds its input, so the
speed limit holds; after the first window of length speed / acceleration the acceleration limit holds too; the shorter
windows that follow make jerk and snap finite (Biagiotti & Melchiorri 2012, FIR filters for trajectory planning).
"""

from typing import NamedTuple

import numpy as np

from uavbench.trajectories.paths.timing import check_flight_time
from uavbench.trajectories.pose import Array
from uavbench.trajectories.vehicle.quadrotor import STEP_S

SHORTER_WINDOWS = (0.5, 0.25, 0.125)
"""Lengths of the later windows over that of the first."""


class PlacesAndYaws(NamedTuple):
    """Positions (n, 3) in metres and unwrapped yaws (n,) in rad, one for each control step."""

    positions_m: Array
    yaws_rad: Array


def progress(total: float, speed: float, acceleration: float) -> Array:
    """Distance covered (n,), metres, from 0 to `total`, at rest at both ends."""
    return _smoothed(_ramp(np.array([[0.0], [total]]), np.array([abs(total) / speed]), 0), speed, acceleration)[:, 0]


def stop_and_go(
    points: Array, yaws_rad: Array, speed: float, acceleration: float, yaw_rate_rad_s: float, dwell_s: float = 0.0
) -> PlacesAndYaws:
    """Straight lines through points (k, 3) in metres with yaws (k,), at rest for dwell_s at each of them.

    Limits: speed in m/s, acceleration in m/s^2, yaw rate in rad/s. UserError for a flight that is too long.
    """
    return _through(
        points, yaws_rad, speed, acceleration, yaw_rate_rad_s, int(_windows(speed, acceleration).sum()), dwell_s
    )


def fly_through(
    points: Array, yaws_rad: Array, speed: float, acceleration: float, yaw_rate_rad_s: float
) -> PlacesAndYaws:
    """Motion past points (k, 3) in metres with yaws (k,) in rad without stopping, cutting the corners.

    The first window is twice as long, because the velocity may reverse at a corner. Limits and errors as `stop_and_go`.
    """
    return _through(points, yaws_rad, speed, acceleration / 2, yaw_rate_rad_s, 0, 0.0)


def _through(
    points: Array, yaws: Array, speed: float, acceleration: float, yaw_rate: float, rest: int, dwell_s: float
) -> PlacesAndYaws:
    table = np.column_stack([points, np.unwrap(yaws)])
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turned = np.abs(np.diff(table[:, 3]))
    seconds = np.maximum(moved / speed, turned / yaw_rate)
    smooth = _smoothed(_ramp(table, seconds, rest + round(dwell_s / STEP_S)), speed, acceleration)
    return PlacesAndYaws(smooth[:, :3], smooth[:, 3])


def _ramp(table: Array, seconds: Array, rest: int) -> Array:
    """Samples of straight lines between rows, each `seconds` long, with `rest` samples at rest at each row."""
    knots, times = [], []
    now = 0.0
    for i, row in enumerate(table):
        knots.append(row)
        times.append(now)
        if 0 < i < len(table) - 1 and rest:
            now += rest * STEP_S
            knots.append(row)
            times.append(now)
        if i < len(seconds):
            now += max(seconds[i], 1e-9)
    check_flight_time(now)
    at = np.arange(int(np.ceil(now / STEP_S)) + 1) * STEP_S
    columns = np.array(knots)
    return np.column_stack([np.interp(at, times, columns[:, j]) for j in range(columns.shape[1])])


def _windows(speed: float, acceleration: float) -> Array:
    """Lengths of the windows in samples."""
    first = speed / acceleration / STEP_S
    check_flight_time(first * STEP_S)
    return np.maximum(2, np.ceil(first * np.array([1.0, *SHORTER_WINDOWS])))


def _smoothed(samples: Array, speed: float, acceleration: float) -> Array:
    """Moving averages of samples (n, k), at rest before and after; the result is longer by the windows."""
    windows = _windows(speed, acceleration).astype(int)
    start = samples[0]
    out = samples - start
    for width in windows:
        # The average of the steps is a difference over the window; summing positions instead would lose digits.
        padded = np.concatenate([np.zeros((width, out.shape[1])), out, np.repeat(out[-1:], width - 1, axis=0)])
        out = np.cumsum((padded[width:] - padded[:-width]) / width, axis=0)
    return np.asarray(out + start)
