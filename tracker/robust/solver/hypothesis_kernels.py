"""Compiled RANSAC: the camera motion that agrees with candidates of most edges (Fischler & Bolles 1981)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import factor6, substitute6
from uavbench.tracker.robust.edges.measurements import EDGE_MEASUREMENTS, EdgeMeasurements
from uavbench.tracker.robust.solver.sum_kernels import add_row_of_pose
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

HYPOTHESES = 256
"""Number of hypotheses per frame: where one of four candidates is the right one, at least one begins with three right
ones with a probability of 98.2 % (Fischler & Bolles 1981). Measured from poses that are off by 1.5 and 3 % of the range
and of a radian: with 64 of them 221 and 138 of 320 fits reach the right pose, with 256 of them 286 and 207.
"""
EDGES_DRAWN = 3
"""Number of edges of a hypothesis: two candidates on each determine the six unknowns."""
SIGMAS_TO_OUTLIER = 4.0
"""Outlier limit in standard deviations of a candidate."""
SCORED_POINTS = 96
"""Number of control points that score a hypothesis; limits its time: with all of them poses are no better."""
DRAWS_PER_EDGE = 4
"""Random numbers per edge of a hypothesis: control point, other point of its edge, candidate, and one unused."""

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


@inlined(allocates=False)
def add_drawn(measured: EdgeMeasurements, of: Drawable, draws: Array, outlier_px: float, A: Array, b: Array) -> None:
    """Add the candidates selected by `draws` (12,) to the normal equations (A, b), in place.

    Edges are drawn with a probability proportional to their number of control points: first a point, then its edge.
    """
    distance, J, first = measured.candidates.distance, measured.lines.jacobian, measured.points.first
    n, k = distance.shape
    information = (SIGMAS_TO_OUTLIER / outlier_px) ** 2
    for s in range(EDGES_DRAWN):
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
        add_row_of_pose(A, b, J[p], d, information)
        near = np.inf
        for c in range(k):
            if abs(distance[q, c] - d) < abs(near - d):
                near = distance[q, c]
        if q != p and near < np.inf:
            add_row_of_pose(A, b, J[q], near, information)


@inlined(allocates=False)
def motion_cost(measured: EdgeMeasurements, x: Array, prior: Array, most: float, outlier_px: float) -> float:
    """Cost of a twist x (6,): truncated squared distances of the control points, plus the prior; aborted at `most`.

    Control points are thinned to about SCORED_POINTS.
    """
    distance = measured.candidates.distance
    J, weight = measured.lines.jacobian, measured.weight
    n, k = distance.shape
    stride = max(1, n // SCORED_POINTS)
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
            r = (distance[p, c] - moved) / outlier_px
            least = min(least, r * r)
        cost += weight[p] * least
        if cost > most:
            break
    return cost


@compiled("measured f2 f2 f0", measured=EDGE_MEASUREMENTS)
def best_motion(measured: EdgeMeasurements, prior: Array, draws: Array, outlier_px: float) -> Array:
    """The camera twist (6,) of least cost among all hypotheses.

    draws (h, 12): uniform numbers; each hypothesis uses two candidates on each of three edges. prior (6, 6):
    information of the predicted pose. Candidates beyond outlier_px are outliers. The first hypothesis is no motion.
    """
    n, of = len(measured.candidates.distance), drawable(measured)
    best, best_cost = np.zeros(6), np.inf
    x = np.zeros(6)
    A, b = np.empty((6, 6)), np.empty(6)
    for h in range(len(draws) + 1 if n > 0 else 0):
        if h > 0:
            for i in range(6):
                b[i] = 0.0
                for j in range(6):
                    A[i, j] = prior[i, j]
            add_drawn(measured, of, draws[h - 1], outlier_px, A, b)
            if not factor6(A, A):
                continue
            substitute6(A, b, x)
        cost = motion_cost(measured, x, prior, best_cost, outlier_px)
        if cost < best_cost:
            best_cost = cost
            for i in range(6):
                best[i] = x[i]
    return best
