"""Compiled loops of the published method: crossings of search lines, hypotheses and their costs, Gauss-Newton."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import normal_row, se3_exp_left, se3_log_left, solve6
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

ITERATIONS = 3
"""Gauss-Newton steps of a pose update, whose start is within a search line's length of its result."""


@compiled("f2 f2 f2 f0 f0 f2!")
def crossings(pixels: Array, normals: Array, segments: Array, search_px: float, max_sine: float, out: Array) -> None:
    """Signed distances (n, k) at which the search lines cross segments (m, 4): the k nearest, then inf.

    Ties are in the order of the segments.
    """
    m, k = len(segments), out.shape[1]
    out[:] = np.inf
    for j in range(m):
        x0, y0 = segments[j, 0], segments[j, 1]
        dx, dy = segments[j, 2] - x0, segments[j, 3] - y0
        length = math.sqrt(dx * dx + dy * dy)
        for i in range(len(pixels)):
            nx, ny = normals[i, 0], normals[i, 1]
            if not abs(dx / length * nx + dy / length * ny) < max_sine:
                continue
            # Solve pixel + d normal = start + s direction for d and s by Cramer's rule.
            wx, wy = x0 - pixels[i, 0], y0 - pixels[i, 1]
            cross = nx * dy - ny * dx
            d = (wx * dy - wy * dx) / cross
            s = (wx * ny - wy * nx) / cross
            if not (abs(d) <= search_px and 0.0 <= s <= 1.0 and abs(d) < abs(out[i, k - 1])):
                continue
            place = k - 1
            while place > 0 and abs(out[i, place - 1]) > abs(d):
                out[i, place] = out[i, place - 1]
                place -= 1
            out[i, place] = d


@compiled("i2 f2 f2 f2 f2!")
def twists_of(rows: NDArray[np.int64], wanted: Array, J: Array, prior: Array, out: Array) -> None:
    """Twists (h, 6) that move the control points rows (h, k), with Jacobians J (n, 6), by wanted (h, k) px."""
    for h in range(len(rows)):
        A, b = prior.copy(), np.zeros(6)
        for k in range(rows.shape[1]):
            row = J[rows[h, k]]
            for i in range(6):
                b[i] += row[i] * wanted[h, k]
                for j in range(i + 1):  # solve6 reads the lower half
                    A[i, j] += row[i] * row[j]
        if not solve6(A, b, out[h]):
            out[h] = np.nan


@compiled("f2 f1 f2 f2 f0")
def cheapest(twists: Array, extra: Array, J: Array, distances: Array, inlier_px: float) -> int:
    """Index of the twist (h,) of least cost, the first of equals.

    The cost is extra (h,) plus the truncated squared distance errors of the best set of candidates (n, k).
    """
    best, least = 0, np.inf
    for h in range(len(twists)):
        cost = extra[h]
        for n in range(len(J)):
            if distances[n, 0] == np.inf:
                continue
            predicted = 0.0
            for i in range(6):
                predicted += J[n, i] * twists[h, i]
            error = inlier_px
            for k in range(distances.shape[1]):
                if distances[n, k] == np.inf:
                    break
                error = min(error, abs(predicted - distances[n, k]))
            cost += error * error
            if cost >= least:
                break
        if cost < least:
            best, least = h, cost
    return best


class SolvedPose(NamedTuple):
    """A pose R (3, 3), t (3,) and its information (6, 6)."""

    R: Array
    t: Array
    information: Array


@compiled("f2 f2 f1 f1 f2 f1 f2")
def gauss_newton(
    points_m: Array, normals: Array, target: Array, cam: Array, R: Array, t: Array, prior: Array
) -> SolvedPose:
    """The pose at which points (n, 3) are at target (n,) px along their normals, with its information.

    prior (6, 6): information of the start pose (R, t); cam: array of a camera without distortion.
    """
    R_first, t_first = R, t
    R, t = R.copy(), t.copy()
    information = prior.copy()
    row, xi = np.zeros(6), np.zeros(6)
    for _ in range(ITERATIONS):
        information = prior.copy()
        b = prior @ se3_log_left(R, t, R_first, t_first)
        for n in range(len(points_m)):
            p = points_m[n]
            x = R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0]
            y = R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1]
            z = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
            nx, ny = normals[n, 0], normals[n, 1]
            normal_row(x, y, z, nx, ny, cam, row)
            left = target[n] - (nx * (cam[0] * x / z + cam[2]) + ny * (cam[1] * y / z + cam[3]))
            for i in range(6):
                b[i] += row[i] * left
                for j in range(6):
                    information[i, j] += row[i] * row[j]
        if not solve6(information, b, xi):
            xi[:] = np.nan
        R, t = se3_exp_left(R, t, xi)
    return SolvedPose(R, t, information)
