"""Compiled choice: which motion of the camera do candidates of several edges agree on (Fischler & Bolles 1981)."""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import solve6
from uavbench.tracker.robust.config.solver import HypothesesConfig
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.tracker.robust.solver.solve_kernels import add_row
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

HYPOTHESES = kernel_type(HypothesesConfig)

Indices = NDArray[np.int64]


@compiled("f2 f2 f2 f1 i1 f2 f2 hypotheses", hypotheses=HYPOTHESES)
def hypotheses(
    J: Array,
    distance: Array,
    penalty: Array,
    trust: Array,
    first: Indices,
    prior: Array,
    draws: Array,
    config: HypothesesConfig,
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
    stride = max(1, n // config.scored_points)
    information = 1.0 / (config.candidate_sigma_px * config.candidate_sigma_px)
    counts = np.zeros(n, np.int64)
    for p in range(n):
        for c in range(k):
            if distance[p, c] < np.inf:
                counts[p] += 1
    for h in range(len(draws) + 1 if n > 0 else 0):
        if h > 0:
            for i in range(6):
                b[i] = 0.0
                for j in range(6):
                    A[i, j] = prior[i, j]
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
                add_row(A, b, J[p], d, information)
                near = np.inf
                for c in range(k):
                    if abs(distance[q, c] - d) < abs(near - d):
                        near = distance[q, c]
                if q != p and near < np.inf:
                    add_row(A, b, J[q], near, information)
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
                r = (distance[p, c] - moved) / config.inlier_px
                least = min(least, r * r + config.colour_cost * penalty[p, c])
            cost += trust[p] * least
            if cost > best_cost:
                break
        if cost < best_cost:
            best_cost = cost
            for i in range(6):
                best[i] = x[i]
    return best, best_cost / max(1, n // stride)
