"""Compiled choice and update: hypotheses over the candidates, then an M-estimator on those that agree."""

import math

import numpy as np
from numpy.typing import NDArray

from tracker.compiled import compiled
from tracker.geometry_kernels import move, normal_row, project, solve6, twist_between
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
    counts = np.zeros(n, np.int64)
    for p in range(n):
        for c in range(k):
            if distance[p, c] < np.inf:
                counts[p] += 1
    for h in range(len(draws) + 1 if n > 0 else 0):
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
                add_row(A, b, J[p], d, HYPOTHESIS_INFORMATION)
                near = np.inf
                for c in range(k):
                    if abs(distance[q, c] - d) < abs(near - d):
                        near = distance[q, c]
                if q != p and near < np.inf:
                    add_row(A, b, J[q], near, HYPOTHESIS_INFORMATION)
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
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """The pose that brings control points onto their best candidates and patches to where they were observed.

    Gauss-Newton with Tukey's weights of the widths `scales` in px one after the other, over variance in px^2. The
    candidates of points (n, 3) lie at distance (n, k) from lines (n, 4); those of patches, at places (m, 3) in the
    world, are observed (m, 2) where found (m,) > 0. All places err together as a pose of map_covariance (6, 6) does.
    Returns R, t, the information (6, 6) with that of the prediction, the signed residual (n,) and weight (n,) in
    [0, trust] of each control point, the weight (m,) in [0, 1] of each patch, the information (6, 6) of the edges
    alone, and the twist (6,) that the edges would move the pose of the patches by, times that information.
    """
    n, k = distance.shape
    m = len(places)
    weights, residual, patch_weights = np.zeros(n), np.zeros(n), np.zeros(m)
    row, c, step, x_patch = np.zeros(6), np.empty(3), np.zeros(6), np.zeros(6)
    E, e, P, q, A, b = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)
    pull = np.zeros(6)
    for scale in scales:
        E[:], e[:], P[:], q[:] = 0.0, 0.0, 0.0, 0.0
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
    return R, t, A, residual, weights, patch_weights, E, pull


@compiled
def mirror(A: Array) -> None:
    """Copy the lower half of a matrix (6, 6) to the upper one."""
    for i in range(6):
        for j in range(i):
            A[j, i] = A[i, j]


@compiled
def eliminate(M: Array, N: Array) -> None:
    """Put M^-1 N into N (6, k), by Gauss-Jordan elimination with partial pivoting; M (6, 6) is used up."""
    k = N.shape[1]
    for i in range(6):
        pivot = i
        for r in range(i + 1, 6):
            if abs(M[r, i]) > abs(M[pivot, i]):
                pivot = r
        if pivot != i:
            for j in range(6):
                M[i, j], M[pivot, j] = M[pivot, j], M[i, j]
            for j in range(k):
                N[i, j], N[pivot, j] = N[pivot, j], N[i, j]
        scale = 1.0 / M[i, i]
        for j in range(6):
            M[i, j] *= scale
        for j in range(k):
            N[i, j] *= scale
        for r in range(6):
            if r != i:
                f = M[r, i]
                for j in range(6):
                    M[r, j] -= f * M[i, j]
                for j in range(k):
                    N[r, j] -= f * N[i, j]


@compiled
def update_map(C: Array, E: Array, pull: Array, alike: float, forget: float) -> tuple[Array, Array]:
    """Twist (6,) by which the patches' places err as one, and the covariance (6, 6) that is left of C.

    E (6, 6) is what a frame's edges say, pull (6,) = E times the twist that they say; frames err alike for so many in a
    row. C grows by the part `forget` first: what was learned long ago counts less.
    """
    M, N = np.eye(6), (1.0 + forget) * C
    for i in range(6):
        for j in range(6):
            for h in range(6):
                M[i, j] += (1.0 + forget) * C[i, h] * E[h, j] / alike
    eliminate(M, N)
    left = 0.5 * (N + N.T)
    twist = np.zeros(6)
    for i in range(6):
        for j in range(6):
            twist[i] += left[i, j] * pull[j] / alike
    return twist, left


@compiled
def carried(C: Array, R: Array, t: Array) -> Array:
    """Covariance (6, 6) of a twist after the frame has moved by (R, t): Ad C Ad^T."""
    X = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            X[i, j] = X[3 + i, 3 + j] = R[i, j]
    for j in range(3):
        X[0, 3 + j] = t[1] * R[2, j] - t[2] * R[1, j]
        X[1, 3 + j] = t[2] * R[0, j] - t[0] * R[2, j]
        X[2, 3 + j] = t[0] * R[1, j] - t[1] * R[0, j]
    out, half = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for h in range(6):
                half[i, j] += X[i, h] * C[h, j]
    for i in range(6):
        for j in range(6):
            for h in range(6):
                out[i, j] += half[i, h] * X[j, h]
    return out


@compiled
def line_variance(first: Indices, distance: Array, own: Array, common: Array) -> Array:
    """Variance (n,) in px^2 that makes the control points of an edge count no more than their shared error allows.

    own (n,) is the error of each control point, common (n,) that which all on the same edge share; edges begin at the
    rows first (e + 1,); distance (n, k) is inf where nothing was found. With m points on an edge each gets
    own + m common, so that the edge's mean has own / m + common.
    """
    out = np.empty(len(own))
    for e in range(len(first) - 1):
        m = 0
        for p in range(first[e], first[e + 1]):
            if distance[p, 0] < np.inf:
                m += 1
        for p in range(first[e], first[e + 1]):
            out[p] = own[p] + m * common[p]
    return out


@compiled
def inverse6(A: Array) -> Array:
    """Inverse of a symmetric positive matrix (6, 6); NaN where it is none."""
    out, unit, column = np.empty((6, 6)), np.zeros(6), np.zeros(6)
    for j in range(6):
        unit[:] = 0.0
        unit[j] = 1.0
        if not solve6(A, unit, column):
            out[:] = math.nan
            return out
        out[:, j] = column
    return 0.5 * (out + out.T)
