"""Compiled update: an M-estimator over the candidates of the control points and the patches."""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import eliminate, move, normal_row, project, solve6, twist_between
from uavbench.tracker.robust.config.solver import EstimatorConfig
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.tracker.robust.solver.bias_kernels import Sums
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

NEAR_M = 0.02
"""Points nearer to the camera's plane than this are not projected."""
ESTIMATOR = kernel_type(EstimatorConfig)

Indices = NDArray[np.int64]


@compiled("f2! f1! f1 f0 f0", inner=True)
def add_row(A: Array, b: Array, row: Array, d: float, w: float) -> None:
    """Add the equation row . x = d of weight w to the normal equations (lower half of A)."""
    for i in range(6):
        wi = w * row[i]
        b[i] += wi * d
        for j in range(i + 1):
            A[i, j] += wi * row[j]


@compiled("f2 f2 f2 f2 f1 f1 i1 f2 f2 f1 f1 (f2 f1 f2 f1 f1) f2 f2 f1 f2 f1 f1 f1 estimator", estimator=ESTIMATOR)
def refine(
    points: Array,
    lines: Array,
    distance: Array,
    penalty: Array,
    trust: Array,
    variance: Array,
    first: Indices,
    places: Array,
    observed: Array,
    found: Array,
    patch_variance: Array,
    shared: tuple[Array, Array, Array, Array, Array],
    prior: Array,
    R_predicted: Array,
    t_predicted: Array,
    R: Array,
    t: Array,
    cam: Array,
    scales: Array,
    config: EstimatorConfig,
) -> tuple[Array, Array, Array, Array, Array, Array, Sums, Array, Array, float]:
    """The pose that brings control points onto their best candidates and patches to where they were observed.

    Gauss-Newton with Tukey's weights of the widths `scales` in px one after the other, over variance in px^2. The
    candidates of points (n, 3) lie at distance (n, k) from lines (n, 4), those of an edge from row first (g + 1,) on;
    patches, at places (m, 3) in the world, are observed (m, 2) with patch_variance (m,) where found (m,) > 0. What errs
    alike, all places as a pose and each edge by an offset, is known as `shared` says (see map_kernels.shared_at).
    Returns R, t, the information (6, 6) with that of the prediction, the signed residual (n,) and weight (n,) in
    [0, trust] of each control point, the weight (m,) in [0, 1] of each patch, the sums that the common errors are
    learned from, the twists (6,) from the pose of those sums to the one that the patches tell and to the one returned,
    and how far in px the control points were moved along their lines at most.
    """
    n, k = distance.shape
    m, edges = len(places), len(first) - 1
    R, t = R.copy(), t.copy()
    weights, residual, patch_weights = np.zeros(n), np.zeros(n), np.zeros(m)
    row, c, step, x_patch = np.zeros(6), np.empty(3), np.zeros(6), np.zeros(6)
    E, e, P, q, A, b = np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6)
    S, s, d = np.zeros(edges), np.zeros((edges, 6)), np.zeros(edges)
    known, known_vector, ties, offset_information, offset_vector = shared
    M, N, mixed, held, farthest = np.empty((6, 6)), np.empty((6, 7)), np.empty((6, 6)), np.empty((6, 6)), 0.0
    for scale in scales:
        farthest = 0.0
        for matrix in (E, P, s):
            matrix.fill(0.0)
        for column in (e, q, S, d):
            column.fill(0.0)
        for g in range(edges):
            for p in range(first[g], first[g + 1]):
                weights[p], residual[p] = 0.0, np.inf
                if trust[p] <= 0.0:
                    continue
                for i in range(3):
                    c[i] = R[i, 0] * points[p, 0] + R[i, 1] * points[p, 1] + R[i, 2] * points[p, 2] + t[i]
                if c[2] < NEAR_M:
                    continue
                u, v = project(c[0], c[1], c[2], cam)
                moved = (u - lines[p, 0]) * lines[p, 2] + (v - lines[p, 1]) * lines[p, 3]
                farthest = max(farthest, abs(moved))
                best, r_best = np.inf, np.inf
                for candidate in range(k):
                    r = distance[p, candidate] - moved
                    cost = r * r / (scale * scale) + config.colour_cost * penalty[p, candidate]
                    if cost < best:
                        best, r_best = cost, r
                residual[p] = r_best
                if best < 1.0:
                    weights[p] = trust[p] * (1.0 - best) * (1.0 - best)
                    normal_row(c[0], c[1], c[2], lines[p, 2], lines[p, 3], cam, row)
                    w = weights[p] / variance[p]
                    add_row(E, e, row, r_best, w)
                    S[g] += w
                    d[g] += w * r_best
                    for i in range(6):
                        s[g, i] += w * row[i]
        for p in range(m):
            patch_weights[p] = 0.0
            if found[p] <= 0.0:
                continue
            for i in range(3):
                c[i] = R[i, 0] * places[p, 0] + R[i, 1] * places[p, 1] + R[i, 2] * places[p, 2] + t[i]
            if c[2] < NEAR_M:
                continue
            u, v = project(c[0], c[1], c[2], cam)
            ru, rv = observed[p, 0] - u, observed[p, 1] - v
            cost = (ru * ru + rv * rv) / (scale * scale)
            if cost < 1.0:
                w = (1.0 - cost) * (1.0 - cost)
                patch_weights[p] = w
                normal_row(c[0], c[1], c[2], 1.0, 0.0, cam, row)
                add_row(P, q, row, ru, w / patch_variance[p])
                normal_row(c[0], c[1], c[2], 0.0, 1.0, cam, row)
                add_row(P, q, row, rv, w / patch_variance[p])
        mirror(E)
        mirror(P)
        # Normal equations of the pose (A, b) and of the patches' common error (M, last column of N), tied by `mixed`
        offset = twist_between(R, t, R_predicted, t_predicted)
        for i in range(6):
            b[i], N[i, 6] = e[i] + q[i], known_vector[i] - q[i]
            for j in range(6):
                b[i] += prior[i, j] * offset[j]
                A[i, j] = E[i, j] + P[i, j] + prior[i, j]
                M[i, j], mixed[i, j] = P[i, j] + known[i, j], -P[i, j]
        for g in range(edges):  # each edge's offset is taken out (Schur's complement)
            if S[g] <= 0.0 and ties[g, 0] == 0.0:
                continue
            scale_g = 1.0 / (offset_information[g] + S[g])
            f = (offset_vector[g] + d[g]) * scale_g
            for i in range(6):
                b[i] -= s[g, i] * f
                N[i, 6] -= ties[g, i] * f
                for j in range(6):
                    A[i, j] -= s[g, i] * s[g, j] * scale_g
                    M[i, j] -= ties[g, i] * ties[g, j] * scale_g
                    mixed[i, j] -= s[g, i] * ties[g, j] * scale_g
        part = config.patches_prior_part  # of the rest holds the pose where the patches alone put it
        for i in range(6):
            row[i] = q[i] + part * b[i]
            for j in range(6):
                held[i, j] = P[i, j] + part * A[i, j]
        if not solve6(held, row, x_patch):
            break
        for i in range(6):
            for j in range(6):
                N[i, j] = mixed[j, i]
        eliminate(M, N)
        for i in range(6):
            for h in range(6):
                b[i] -= mixed[i, h] * N[h, 6]
                for j in range(6):
                    A[i, j] -= mixed[i, h] * N[h, j]
        if not solve6(A, b, step):
            break
        R, t = move(R, t, step)
    return R, t, A, residual, weights, patch_weights, (S, s, d, E, e, P), x_patch, step, farthest


@compiled("f2!", inner=True)
def mirror(A: Array) -> None:
    """Copy the lower half of a matrix (6, 6) to the upper one."""
    for i in range(6):
        for j in range(i):
            A[j, i] = A[i, j]
