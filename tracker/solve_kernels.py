"""Compiled choice and update: hypotheses over the candidates, then an M-estimator on those that agree."""

import math

import numpy as np
from numpy.typing import NDArray

from tracker.compiled import compiled
from tracker.geometry_kernels import solve6
from trajectories.pose import Array

PATCH_WEIGHT = 6.0
"""Weight of a patch's displacement along either axis against that of a control point."""

Indices = NDArray[np.int64]


@compiled
def add_row(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """Add the equation row . x = d of weight w to the normal equations."""
    for i in range(6):
        b[i] += w * row[i] * d
        for j in range(6):
            A[i, j] += w * row[i] * row[j]


@compiled
def hypotheses(
    J: Array,
    distance: Array,
    penalty: Array,
    trust: Array,
    first: Indices,
    prior: Array,
    draws: Array,
    inlier_px: float,
) -> tuple[Array, float]:
    """The best of many camera motions (6,), and its mean cost per control point in [0, 1].

    trust (n,) in [0, 1] weighs the control points; first (e + 1,) are the rows where each edge's control points start.
    draws (h, 12) are uniform numbers: each hypothesis takes two candidates on each of three edges. prior (6, 6) is the
    information of the predicted pose.
    The first hypothesis is no motion.
    """
    n, k = distance.shape
    best, best_cost = np.zeros(6), np.inf
    x = np.zeros(6)
    A, b = np.empty((6, 6)), np.empty(6)
    stride = max(1, n // 96)
    weight = 1.0 / (0.7 * 0.7)
    counts = np.zeros(n, np.int64)
    for p in range(n):
        for c in range(k):
            if distance[p, c] < np.inf:
                counts[p] += 1
    for h in range(len(draws) + 1):
        if h > 0:
            A[:] = prior
            b[:] = 0.0
            for s in range(3):
                # Edges are drawn by their number of control points: a point first, then its edge.
                p = min(n - 1, int(draws[h - 1, 4 * s] * n))
                e = 0
                while first[e + 1] <= p:
                    e += 1
                q = first[e] + min(
                    first[e + 1] - first[e] - 1, int(draws[h - 1, 4 * s + 1] * (first[e + 1] - first[e]))
                )
                if counts[p] == 0:
                    continue
                pick = min(counts[p] - 1, int(draws[h - 1, 4 * s + 2] * counts[p]))
                d = np.inf
                for c in range(k):
                    if distance[p, c] < np.inf:
                        if pick == 0:
                            d = distance[p, c]
                            break
                        pick -= 1
                add_row(A, b, J[p], d, weight)
                near = np.inf
                for c in range(k):
                    if abs(distance[q, c] - d) < abs(near - d):
                        near = distance[q, c]
                if q != p and near < np.inf:
                    add_row(A, b, J[q], near, weight)
            if not solve6(A, b, x):
                continue
        cost = 0.0
        for i in range(6):
            for j in range(6):
                cost += 0.5 * x[i] * prior[i, j] * x[j]
        for p in range(0, n, stride):
            moved = 0.0
            for i in range(6):
                moved += J[p, i] * x[i]
            least = 1.0
            for c in range(k):
                r = (distance[p, c] - moved) / inlier_px
                least = min(least, r * r + 0.1 * penalty[p, c])
            cost += trust[p] * least
            if cost > best_cost:
                break
        if cost < best_cost:
            best_cost = cost
            best[:] = x
    return best, best_cost / max(1, n // stride)


@compiled
def m_estimate(
    J: Array,
    distance: Array,
    penalty: Array,
    trust: Array,
    J_patch: Array,
    moved: Array,
    found: Array,
    prior: Array,
    offset: Array,
    start: Array,
    scales: Array,
) -> tuple[Array, Array, Array, Array]:
    """Camera motion x (6,) that brings the control points onto their best candidates, robustly.

    Iterated weighted least squares with Tukey's weights, of the widths `scales` in px one after the other, times
    trust (n,). Patches with J_patch (m, 2, 6) and displacements (m, 2) take part where found (m,) > 0. `offset` (6,) is
    the predicted motion and `prior` (6, 6) its information. Returns x, the information at 1 px without the prior
    (6, 6), and the weights of control points (n,) and of patches (m,).
    """
    n, k = distance.shape
    x = start.copy()
    step = np.zeros(6)
    weights, patch_weights = np.zeros(n), np.zeros(len(moved))
    A, b, information = np.empty((6, 6)), np.empty(6), np.zeros((6, 6))
    for scale in scales:
        information[:] = 0.0
        b[:] = 0.0
        for p in range(n):
            shift = 0.0
            for i in range(6):
                shift += J[p, i] * x[i]
            best, r_best = np.inf, np.inf
            for c in range(k):
                r = distance[p, c] - shift
                cost = r * r / (scale * scale) + 0.1 * penalty[p, c]
                if cost < best:
                    best, r_best = cost, r
            weights[p] = 0.0
            if best < 1.0:
                w = 1.0 - best
                weights[p] = trust[p] * w * w
                add_row(information, b, J[p], r_best, weights[p])
        for p in range(len(moved)):
            patch_weights[p] = 0.0
            if found[p] <= 0.0:
                continue
            ru, rv = moved[p, 0], moved[p, 1]
            for i in range(6):
                ru -= J_patch[p, 0, i] * x[i]
                rv -= J_patch[p, 1, i] * x[i]
            cost = (ru * ru + rv * rv) / (scale * scale)
            if cost < 1.0:
                w = PATCH_WEIGHT * (1.0 - cost) * (1.0 - cost)
                patch_weights[p] = w
                add_row(information, b, J_patch[p, 0], ru, w)
                add_row(information, b, J_patch[p, 1], rv, w)
        for i in range(6):
            for j in range(6):
                A[i, j] = information[i, j] + prior[i, j]
                b[i] += prior[i, j] * (offset[j] - x[j])
        if not solve6(A, b, step):
            break
        for i in range(6):
            x[i] += step[i]
    return x, information, weights, patch_weights


@compiled
def sandwich(
    J: Array,
    weights: Array,
    edge: Indices,
    J_patch: Array,
    patch_weights: Array,
    group: Indices,
    A: Array,
    sigma: float,
    common: float,
    patch_sigma: float,
    patch_common: float,
) -> Array:
    """Covariance (6, 6) of the least-squares motion with information A at 1 px.

    The error of a control point is sigma px of its own and `common` px shared by its edge; edge (n,) ascending. That
    of a patch is, along either axis, patch_sigma px of its own and patch_common px shared by its face; group (m,) are
    the patches' faces, counted from 0.
    """
    B = np.zeros((6, 6))
    shared = np.zeros((len(group) + 1, 2, 6))
    for p in range(len(J_patch)):
        for axis in range(2):
            for i in range(6):
                shared[group[p], axis, i] += patch_common * patch_weights[p] * J_patch[p, axis, i]
    for g in range(len(shared)):
        for axis in range(2):
            for i in range(6):
                for j in range(6):
                    B[i, j] += shared[g, axis, i] * shared[g, axis, j]
    for p in range(len(J_patch)):
        w = patch_sigma * patch_weights[p]
        for axis in range(2):
            for i in range(6):
                for j in range(6):
                    B[i, j] += w * w * J_patch[p, axis, i] * J_patch[p, axis, j]
    total = np.zeros(6)
    n = len(J)
    for p in range(n):
        for i in range(6):
            total[i] += weights[p] * J[p, i]
            for j in range(6):
                B[i, j] += sigma * sigma * weights[p] * weights[p] * J[p, i] * J[p, j]
        if p == n - 1 or edge[p + 1] != edge[p]:
            for i in range(6):
                for j in range(6):
                    B[i, j] += common * common * total[i] * total[j]
            total[:] = 0.0
    inverse = np.empty((6, 6))
    unit, column = np.zeros(6), np.zeros(6)
    for j in range(6):
        unit[:] = 0.0
        unit[j] = 1.0
        if not solve6(A, unit, column):
            return np.full((6, 6), math.nan)
        inverse[:, j] = column
    C = inverse @ B @ inverse.T
    return 0.5 * (C + C.T)
