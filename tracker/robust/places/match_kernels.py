"""Compiled RANSAC: the pose near a start at which most matches agree (Fischler & Bolles 1981)."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion, se3_exp_left, solve6
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import RIGID_MOTION
from uavbench.tracker.robust.solver.sum_kernels import add_row
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

HYPOTHESES, SAMPLE = 128, 3
"""Hypotheses, and matches of each, which determine its pose. Where three of ten matches are right, and every match is
drawn as often, one has three right ones with a probability of 97 %."""
STEPS = 6
"""Gauss-Newton steps of a hypothesis, in which turns of 40 degrees converge."""
REFINEMENTS = 10
"""Steps in which the best hypothesis is refined by all matches that agree with it."""
DAMPING = 1e-6
"""Part by which the normal equations of points on a line are kept positive definite."""
LEAST_DEPTH = 1e-3
"""Least depth of a point before the camera, as a part of that of the first one at the start."""
LEAST_AGREEING = 2 * SAMPLE
"""Matches that agree at least: the three that determine a pose always do."""
UNLIMITED = 1e3
"""A limit of errors that none reaches, in units of the focal length."""


class MatchedPose(NamedTuple):
    """A pose R (3, 3), t (3,) and the cost of all matches at it, at most 1 each; inf where there is none."""

    R: Array
    t: Array
    cost: float


@compiled("pose f1 f1 f1", inner=True, allocates=False, pose=RIGID_MOTION)
def error_of(pose: RigidMotion, point: Array, seen: Array, limits: Array) -> float:
    """Squared error of a match in units of its limit; inf where it is nearer than its least depth: see `add_match`."""
    R, t, limit, least = pose.R, pose.t, limits[0], limits[1]
    z = R[2, 0] * point[0] + R[2, 1] * point[1] + R[2, 2] * point[2] + t[2]
    if not z > least:
        return np.inf
    du = seen[0] - (R[0, 0] * point[0] + R[0, 1] * point[1] + R[0, 2] * point[2] + t[0]) / z
    dv = seen[1] - (R[1, 0] * point[0] + R[1, 1] * point[1] + R[1, 2] * point[2] + t[1]) / z
    return float((du * du + dv * dv) / (limit * limit))


@compiled("pose f1 f1 f1 f2! f1!", inner=True, pose=RIGID_MOTION)
def add_match(pose: RigidMotion, point: Array, seen: Array, limits: Array, A: Array, b: Array) -> float:
    """Add a match, weighed by Tukey's biweight, to the normal equations (A, b), in place.

    limits (2,): of its error, in units of which the squared error is returned and beyond which it is not added; and of
    its depth, nearer than which its error is inf.
    """
    R, t, limit, least = pose.R, pose.t, limits[0], limits[1]
    x = R[0, 0] * point[0] + R[0, 1] * point[1] + R[0, 2] * point[2] + t[0]
    y = R[1, 0] * point[0] + R[1, 1] * point[1] + R[1, 2] * point[2] + t[1]
    z = R[2, 0] * point[0] + R[2, 1] * point[1] + R[2, 2] * point[2] + t[2]
    if not z > least:
        return np.inf
    u, v = x / z, y / z
    du, dv = seen[0] - u, seen[1] - v
    error = (du * du + dv * dv) / (limit * limit)
    if error < 1.0:
        w = (1.0 - error) * (1.0 - error)
        add_row(A, b, np.array([1.0 / z, 0.0, -u / z, -u * v, 1.0 + u * u, -v]), du, w)
        add_row(A, b, np.array([0.0, 1.0 / z, -v / z, -1.0 - v * v, u * v, u]), dv, w)
    return float(error)


@compiled("f2! f1 f1!", inner=True)
def solve_damped(A: Array, b: Array, x: Array) -> None:
    """Solve the normal equations for the twist x (6,), in place; NaN where they have no solution."""
    for i in range(6):
        A[i, i] += DAMPING * A[i, i]
    if not solve6(A, b, x):
        x[:] = np.nan


@compiled("pose f2 f2 f1 f0", inner=True, allocates=False, pose=RIGID_MOTION)
def cost_of(pose: RigidMotion, points: Array, seen: Array, limits: Array, most: float) -> float:
    """Sum of the squared errors of matches in units of their limit, each at most 1; it ends above `most`."""
    cost, row = 0.0, 0
    while row < len(points) and cost < most:
        error = error_of(pose, points[row], seen[row], limits)
        cost += error if error < 1.0 else 1.0
        row += 1
    return cost


@compiled("f2 f2 f2 f1 f2 f0")
def pose_of_matches(points: Array, seen: Array, R: Array, t: Array, samples: Array, threshold: float) -> MatchedPose:
    """The pose at which most points (n, 3) are where they are seen, (n, 2) in units of the focal length.

    The best matches come first and are drawn most often (as in Chum & Matas 2005). R, t: start of every hypothesis;
    samples (k, 3) in [0, 1): the matches of each; threshold: error from which a match does not agree.
    """
    n = len(points)
    least = LEAST_DEPTH * abs(R[2] @ points[0] + t[2])
    start, limits, free = RigidMotion(R.copy(), t.copy()), np.array([threshold, least]), np.array([UNLIMITED, least])
    best, lowest = start, np.inf
    A, b, xi = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for k in range(len(samples)):
        pose = start
        for _ in range(STEPS):
            A[:], b[:] = 0.0, 0.0
            for s in range(SAMPLE):
                row = int(samples[k, s] * samples[k, s] * n)
                add_match(pose, points[row], seen[row], free, A, b)
            solve_damped(A, b, xi)
            pose = se3_exp_left(pose.R, pose.t, xi)
        cost = cost_of(pose, points, seen, limits, lowest)
        if cost < lowest:
            best, lowest = pose, cost
    pose = best
    for _ in range(REFINEMENTS):
        A[:], b[:] = 0.0, 0.0
        for row in range(n):
            add_match(pose, points[row], seen[row], limits, A, b)
        solve_damped(A, b, xi)
        pose = se3_exp_left(pose.R, pose.t, xi)
    cost = cost_of(pose, points, seen, limits, lowest)
    if cost < lowest:
        best, lowest = pose, cost
    return MatchedPose(best.R, best.t, lowest if lowest <= n - LEAST_AGREEING else np.inf)
