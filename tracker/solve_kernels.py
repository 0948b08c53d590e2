"""Compiled update: an M-estimator over the candidates of the control points and the patches."""

import numpy as np
from numpy.typing import NDArray

from tracker.compiled import compiled
from tracker.geometry_kernels import eliminate, move, normal_row, project, solve6, twist_between
from trajectories.pose import Array

HYPOTHESIS_INFORMATION = 1.0 / 0.7**2
"""Information of a candidate in a hypothesis, 1/px^2."""
PATCHES_HELD = 0.01
"""Share of all that is known which holds the pose of the patches alone."""

Indices = NDArray[np.int64]


@compiled
def add_row(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """Add the equation row . x = d of weight w to the normal equations (lower half of A)."""
    for i in range(6):
        wi = w * row[i]
        b[i] += wi * d
        for j in range(i + 1):
            A[i, j] += wi * row[j]


@compiled
def refine(
    points: Array,
    lines: Array,
    distance: Array,
    penalty: Array,
    trust: Array,
    variance: Array,
    places: Array,
    observed: Array,
    found: Array,
    patch_variance: float,
    map_covariance: Array,
    prior: Array,
    R_predicted: Array,
    t_predicted: Array,
    R: Array,
    t: Array,
    cam: Array,
    scales: Array,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, float]:
    """The pose that brings control points onto their best candidates and patches to where they were observed.

    Gauss-Newton with Tukey's weights of the widths `scales` in px one after the other, over variance in px^2. The
    candidates of points (n, 3) lie at distance (n, k) from lines (n, 4); those of patches, at places (m, 3) in the
    world, are observed (m, 2) where found (m,) > 0. All places err together as a pose of map_covariance (6, 6) does.
    Returns R, t, the information (6, 6) with that of the prediction, the signed residual (n,) and weight (n,) in
    [0, trust] of each control point, the weight (m,) in [0, 1] of each patch, the information (6, 6) of the edges
    alone, the twist (6,) that the edges would move the pose of the patches by, times that information,
    and how far in px the control points were moved along their lines at most.
    """
    n, k = distance.shape
    m = len(places)
    weights, residual, patch_weights = np.zeros(n), np.zeros(n), np.zeros(m)
    row, c, step, x_patch = np.zeros(6), np.empty(3), np.zeros(6), np.zeros(6)
    E, e, P, q, A, b = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)
    pull, farthest = np.zeros(6), 0.0
    for scale in scales:
        E[:], e[:], P[:], q[:], farthest = 0.0, 0.0, 0.0, 0.0, 0.0
        for p in range(n):
            weights[p], residual[p] = 0.0, np.inf
            if trust[p] <= 0.0:
                continue
            for i in range(3):
                c[i] = R[i, 0] * points[p, 0] + R[i, 1] * points[p, 1] + R[i, 2] * points[p, 2] + t[i]
            if c[2] < 0.02:
                continue
            u, v = project(c[0], c[1], c[2], cam)
            moved = (u - lines[p, 0]) * lines[p, 2] + (v - lines[p, 1]) * lines[p, 3]
            farthest = max(farthest, abs(moved))
            best, r_best = np.inf, np.inf
            for s in range(k):
                r = distance[p, s] - moved
                cost = r * r / (scale * scale) + 0.1 * penalty[p, s]
                if cost < best:
                    best, r_best = cost, r
            residual[p] = r_best
            if best < 1.0:
                weights[p] = trust[p] * (1.0 - best) * (1.0 - best)
                normal_row(c[0], c[1], c[2], lines[p, 2], lines[p, 3], cam, row)
                add_row(E, e, row, r_best, weights[p] / variance[p])
        for p in range(m):
            patch_weights[p] = 0.0
            if found[p] <= 0.0:
                continue
            for i in range(3):
                c[i] = R[i, 0] * places[p, 0] + R[i, 1] * places[p, 1] + R[i, 2] * places[p, 2] + t[i]
            if c[2] < 0.02:
                continue
            u, v = project(c[0], c[1], c[2], cam)
            ru, rv = observed[p, 0] - u, observed[p, 1] - v
            cost = (ru * ru + rv * rv) / (scale * scale)
            if cost < 1.0:
                w = (1.0 - cost) * (1.0 - cost)
                patch_weights[p] = w
                normal_row(c[0], c[1], c[2], 1.0, 0.0, cam, row)
                add_row(P, q, row, ru, w / patch_variance)
                normal_row(c[0], c[1], c[2], 0.0, 1.0, cam, row)
                add_row(P, q, row, rv, w / patch_variance)
        mirror(E)
        mirror(P)
        # The patches' information on the pose, (P^-1 + map_covariance)^-1 = (1 + P map_covariance)^-1 P
        M = np.eye(6)
        N = np.empty((6, 7))
        for i in range(6):
            for j in range(6):
                N[i, j] = P[i, j]
                for h in range(6):
                    M[i, j] += P[i, h] * map_covariance[h, j]
            N[i, 6] = q[i]
        eliminate(M, N)
        offset = twist_between(R, t, R_predicted, t_predicted)
        for i in range(6):
            b[i] = e[i] + N[i, 6]
            for j in range(6):
                b[i] += prior[i, j] * offset[j]
                A[i, j] = E[i, j] + prior[i, j] + 0.5 * (N[i, j] + N[j, i])
        if not solve6(A, b, step):
            break
        # where the patches alone put the pose, held by a little of the rest
        for i in range(6):
            row[i] = q[i] + PATCHES_HELD * b[i]
            for j in range(6):
                M[i, j] = P[i, j] + PATCHES_HELD * A[i, j]
        if solve6(M, row, x_patch):
            for i in range(6):
                pull[i] = e[i]
                for j in range(6):
                    pull[i] -= E[i, j] * x_patch[j]
        R, t = move(R, t, step)
    return R, t, A, residual, weights, patch_weights, E, pull, farthest


@compiled
def mirror(A: Array) -> None:
    """Copy the lower half of a matrix (6, 6) to the upper one."""
    for i in range(6):
        for j in range(i):
            A[j, i] = A[i, j]
