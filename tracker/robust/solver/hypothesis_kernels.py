"""Compiled RANSAC: the camera motion that agrees with candidates of most edges (Fischler & Bolles 1981)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.measurements import EDGE_MEASUREMENTS, EdgeMeasurements
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

HYPOTHESES = 256
"""Most hypotheses per frame: where one of four candidates is the right one, at least one begins with three right
ones with a probability of 98.2 % (Fischler & Bolles 1981). Measured from poses that are off by 1.5 and 3 % of the range
and of a radian: with 64 of them 221 and 138 of 320 fits reach the right pose, with 256 of them 286 and 207.
"""
MISSED = 1e-4
"""Probability with which no hypothesis begins with three right candidates, where the search for a better one ends: once
in ten minutes of frames 15 a second.
"""
EDGES_DRAWN = 3
"""Number of edges of a hypothesis: two candidates on each determine the six unknowns."""
SIGMAS_TO_OUTLIER = 4.0
"""Outlier limit in standard deviations of a candidate."""
SCORED_POINTS = 96
"""Number of control points that score a hypothesis; limits its time: with all of them poses are no better."""
DRAWS_PER_EDGE = 4
"""Random numbers per edge of a hypothesis: control point, other point of its edge, candidate, and one unused."""
ABREAST = 4
"""Hypotheses that are solved at once, as many as a register of most CPUs holds numbers; `solve_abreast` names each."""

Indices = NDArray[np.int64]


class Drawable(NamedTuple):
    """Of each control point (n,): number of its candidates, and its edge."""

    counts: Indices
    edge: Indices


@compiled
def drawable(measured: EdgeMeasurements) -> Drawable:
    """What hypotheses are drawn by, found once for all of them."""
    distance, first = measured.candidates.distance, measured.points.first
    counts, edge = np.zeros(len(distance), np.int64), np.empty(len(distance), np.int64)
    for e in range(len(first) - 1):
        for p in range(first[e], first[e + 1]):
            edge[p] = e
            for c in range(distance.shape[1]):
                counts[p] += int(distance[p, c] < np.inf)
    return Drawable(counts, edge)


class Drawn(NamedTuple):
    """Candidates of ABREAST hypotheses, in turn: rows (6, 6, a) of two for each edge, derivatives for the pose; their
    distances (6, a) in px and information (6, a), 0 for none.
    """

    rows: Array
    distance: Array
    information: Array


@inlined(allocates=False)
def draw(measured: EdgeMeasurements, of: Drawable, draws: Array, information: float, drawn: Drawn, a: int) -> None:
    """Write the candidates selected by `draws` (12,) as those of hypothesis a.

    Edges are drawn with a probability proportional to their number of control points: first a point, then its edge.
    """
    distance, J, first = measured.candidates.distance, measured.lines.jacobian, measured.points.first
    n, k = distance.shape
    for s in range(EDGES_DRAWN):
        drawn.information[2 * s, a] = drawn.information[2 * s + 1, a] = 0.0
        column = DRAWS_PER_EDGE * s
        p = min(n - 1, int(draws[column] * n))
        e = of.edge[p]
        on_edge = first[e + 1] - first[e]
        q = first[e] + min(on_edge - 1, int(draws[column + 1] * on_edge))
        if of.counts[p] == 0:
            continue
        pick = min(of.counts[p] - 1, int(draws[column + 2] * of.counts[p]))
        d = np.inf
        for c in range(k):
            if distance[p, c] < np.inf:
                if pick == 0:
                    d = distance[p, c]
                    break
                pick -= 1
        drawn.distance[2 * s, a], drawn.information[2 * s, a] = d, information
        near = np.inf
        for c in range(k):
            if abs(distance[q, c] - d) < abs(near - d):
                near = distance[q, c]
        if q != p and near < np.inf:
            drawn.distance[2 * s + 1, a], drawn.information[2 * s + 1, a] = near, information
        for i in range(6):
            drawn.rows[2 * s, i, a] = J[p, i]
            drawn.rows[2 * s + 1, i, a] = J[q, i]


@inlined(allocates=False)
def solve_abreast(drawn: Drawn, prior: Array, A: Array, x: Array) -> None:
    """Solve the normal equations of ABREAST hypotheses with a prior (6, 6), in turn, by Cholesky into x (6, a).

    NaN where they are not positive definite. A (6, 6, a) is room for them. Each root and quotient of one waits for the
    last, but not for those of the others.
    """
    for a in range(ABREAST):
        for i in range(6):
            x[i, a] = 0.0
            for j in range(i + 1):
                A[i, j, a] = prior[i, j]
    for s in range(2 * EDGES_DRAWN):
        for a in range(ABREAST):
            w = drawn.information[s, a]
            if w > 0.0:
                for i in range(6):
                    wi = w * drawn.rows[s, i, a]
                    x[i, a] += wi * drawn.distance[s, a]
                    for j in range(i + 1):
                        A[i, j, a] += wi * drawn.rows[s, j, a]
    for i in range(6):
        for j in range(i + 1):
            s0, s1, s2, s3 = A[i, j, 0], A[i, j, 1], A[i, j, 2], A[i, j, 3]
            for k in range(j):
                s0 -= A[i, k, 0] * A[j, k, 0]
                s1 -= A[i, k, 1] * A[j, k, 1]
                s2 -= A[i, k, 2] * A[j, k, 2]
                s3 -= A[i, k, 3] * A[j, k, 3]
            if i == j:
                A[i, i, 0] = math.sqrt(s0) if s0 > 0.0 else np.nan
                A[i, i, 1] = math.sqrt(s1) if s1 > 0.0 else np.nan
                A[i, i, 2] = math.sqrt(s2) if s2 > 0.0 else np.nan
                A[i, i, 3] = math.sqrt(s3) if s3 > 0.0 else np.nan
            else:
                A[i, j, 0], A[i, j, 1] = s0 / A[j, j, 0], s1 / A[j, j, 1]
                A[i, j, 2], A[i, j, 3] = s2 / A[j, j, 2], s3 / A[j, j, 3]
    for step in range(12):
        i = step if step < 6 else 11 - step
        s0, s1, s2, s3 = x[i, 0], x[i, 1], x[i, 2], x[i, 3]
        for k in range(0 if step < 6 else i + 1, i if step < 6 else 6):
            r, c = (i, k) if step < 6 else (k, i)
            s0 -= A[r, c, 0] * x[k, 0]
            s1 -= A[r, c, 1] * x[k, 1]
            s2 -= A[r, c, 2] * x[k, 2]
            s3 -= A[r, c, 3] * x[k, 3]
        x[i, 0], x[i, 1] = s0 / A[i, i, 0], s1 / A[i, i, 1]
        x[i, 2], x[i, 3] = s2 / A[i, i, 2], s3 / A[i, i, 3]


@inlined(allocates=False)
def motion_costs(
    measured: EdgeMeasurements, x: Array, prior: Array, most: float, outlier_px: float, cost: Array
) -> None:
    """Write the costs (a,) of twists x (6, a): truncated squared distances of the control points, plus the prior;
    aborted when all are above `most`.

    Control points are thinned to about SCORED_POINTS.
    """
    distance = measured.candidates.distance
    J, weight = measured.lines.jacobian, measured.weight
    n, k = distance.shape
    stride = max(1, n // SCORED_POINTS)
    for a in range(ABREAST):
        cost[a] = 0.0
        for i in range(6):
            for j in range(6):
                cost[a] += 0.5 * x[i, a] * prior[i, j] * x[j, a]
    c0, c1, c2, c3 = cost[0], cost[1], cost[2], cost[3]
    for p in range(0, n, stride):
        moved0, moved1, moved2, moved3 = 0.0, 0.0, 0.0, 0.0
        for i in range(6):
            moved0 += J[p, i] * x[i, 0]
            moved1 += J[p, i] * x[i, 1]
            moved2 += J[p, i] * x[i, 2]
            moved3 += J[p, i] * x[i, 3]
        r0, r1, r2, r3 = outlier_px, outlier_px, outlier_px, outlier_px
        for c in range(k):
            r0 = min(r0, abs(distance[p, c] - moved0))
            r1 = min(r1, abs(distance[p, c] - moved1))
            r2 = min(r2, abs(distance[p, c] - moved2))
            r3 = min(r3, abs(distance[p, c] - moved3))
        r0, r1, r2, r3 = r0 / outlier_px, r1 / outlier_px, r2 / outlier_px, r3 / outlier_px
        c0 += weight[p] * (r0 * r0)
        c1 += weight[p] * (r1 * r1)
        c2 += weight[p] * (r2 * r2)
        c3 += weight[p] * (r3 * r3)
        if not (c0 <= most or c1 <= most or c2 <= most or c3 <= most):
            break
    cost[0], cost[1], cost[2], cost[3] = c0, c1, c2, c3


@inlined(allocates=False)
def hypotheses_needed(measured: EdgeMeasurements, of: Drawable, x: Array, right_px: float) -> float:
    """Number of hypotheses of which, but for a probability of `MISSED`, one begins with right candidates alone.

    Right are those within right_px of a twist x (6,) (Hartley & Zisserman 2004, algorithm 4.5).
    """
    distance, J = measured.candidates.distance, measured.lines.jacobian
    n, k = distance.shape
    stride, drawn, right = max(1, n // SCORED_POINTS), 0, 0.0
    for p in range(0, n, stride):
        moved, near = 0.0, np.inf
        for i in range(6):
            moved += J[p, i] * x[i]
        for c in range(k):
            near = min(near, abs(distance[p, c] - moved))
        drawn += 1
        if near < right_px:
            right += 1.0 / of.counts[p]
    all_right = (right / drawn) ** EDGES_DRAWN
    return math.log(MISSED) / math.log1p(-all_right) if 0.0 < all_right < 1.0 else (np.inf if all_right == 0.0 else 0.0)


@compiled("measured f2 f2 f0", measured=EDGE_MEASUREMENTS)
def best_motion(measured: EdgeMeasurements, prior: Array, draws: Array, outlier_px: float) -> Array:
    """The camera twist (6,) of least cost among all hypotheses.

    draws (h, 12): uniform numbers, h a multiple of ABREAST; each hypothesis uses two candidates on each of three edges.
    They are tried until those that the best one explains let expect no better one.
    prior (6, 6): information of the predicted pose. Candidates beyond outlier_px are outliers. The first hypothesis is
    no motion.
    """
    best, x, cost = np.zeros(6), np.zeros((6, ABREAST)), np.empty(ABREAST)
    if len(measured.candidates.distance) == 0:
        return best
    of, information = drawable(measured), (SIGMAS_TO_OUTLIER / outlier_px) ** 2
    drawn = Drawn(np.zeros((6, 6, ABREAST)), np.zeros((6, ABREAST)), np.zeros((6, ABREAST)))
    A = np.empty((6, 6, ABREAST))
    motion_costs(measured, x, prior, np.inf, outlier_px, cost)
    best_cost, right_px = cost[0], 2.0 * outlier_px / SIGMAS_TO_OUTLIER
    needed = hypotheses_needed(measured, of, best, right_px)
    for h in range(0, len(draws), ABREAST):
        if h >= needed:
            break
        before = best_cost
        for a in range(ABREAST):
            draw(measured, of, draws[h + a], information, drawn, a)
        solve_abreast(drawn, prior, A, x)
        motion_costs(measured, x, prior, best_cost, outlier_px, cost)
        for a in range(ABREAST):
            if cost[a] < best_cost:
                best_cost = cost[a]
                for i in range(6):
                    best[i] = x[i, a]
        if best_cost < before:
            needed = hypotheses_needed(measured, of, best, right_px)
    return best
