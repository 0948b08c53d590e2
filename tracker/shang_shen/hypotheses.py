"""Steps 8 and 9, low-level multiple hypotheses and RANSAC: selection of the candidate of each control point.

Every control point keeps several candidates (Teuliere, Marchand & Eck 2010). A hypothesis is the camera motion that
fits one candidate at two control points of each of a few edges; the best hypothesis is the one whose best set of
candidates, one or none for each control point, has the smallest distance errors.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.shang_shen.edge_search import Candidates
from uavbench.tracker.shang_shen.kernels import cheapest, twists_of
from uavbench.tracker.shang_shen.pose_update import least_squares
from uavbench.trajectories.pose import Array

RANSAC_HYPOTHESES = 200
"""Number of hypotheses drawn."""
EDGES_PER_HYPOTHESIS = 3
"""Edges per hypothesis: three lines determine a pose."""
MOTION_COST = 150.0
"""Weight of the camera's motion, in units of the weak prior, relative to squared distance errors in px: if the pose is
nearly unconstrained, as in front of a single face, the smaller motion is preferred.
"""
INLIER_PX = 1.0
"""Distance in px from its moved control point beyond which a candidate is an outlier."""


@dataclass(frozen=True, eq=False)
class Matches:
    """The best set: distance (n,) of each control point's candidate, and whether it is an inlier (n,)."""

    distances: Array
    inlier: NDArray[np.bool_]


def best_set(distances: Array, predicted: Array, inlier_px: float = INLIER_PX) -> Matches:
    """The candidates (n, k) nearest to the predicted distances (n,)."""
    error = np.abs(distances - predicted[:, None])
    best = np.arange(len(error)), np.argmin(error, axis=1)
    return Matches(distances[best], error[best] <= inlier_px)


def ransac(
    candidates: Candidates,
    J: Array,
    edge: NDArray[np.int64],
    prior: Array,
    rng: np.random.Generator,
    *,
    hypotheses: int = RANSAC_HYPOTHESES,
    inlier_px: float = INLIER_PX,
) -> Matches:
    """The best set of candidates for control points with Jacobians J (n, 6) on edges `edge` (n,)."""
    twists = _hypothesis_twists(candidates, J, edge, prior, rng, hypotheses)
    motion = MOTION_COST * np.einsum("hi,hi->h", twists @ prior, twists)
    twist = twists[cheapest(twists, motion, J, candidates.distances, inlier_px)]
    matches = best_set(candidates.distances, J @ twist, inlier_px)
    for _ in range(2):  # local optimization on the inliers (Chum, Matas & Kittler 2003)
        if matches.inlier.any():
            twist = least_squares(J[matches.inlier], matches.distances[matches.inlier], prior)
            matches = best_set(candidates.distances, J @ twist, inlier_px)
    return matches


def _hypothesis_twists(
    candidates: Candidates,
    J: Array,
    edge: NDArray[np.int64],
    prior: Array,
    rng: np.random.Generator,
    hypotheses: int,
) -> Array:
    """Camera motions (h, 6), the first of them zero."""
    usable = np.flatnonzero(candidates.counts > 0)
    rows, first, count = np.unique(edge[usable], return_index=True, return_counts=True)
    take = min(EDGES_PER_HYPOTHESIS, len(rows))
    chosen = np.argsort(rng.random((hypotheses, len(rows))), axis=1)[:, :take]
    a = usable[first[chosen] + (rng.random(chosen.shape) * count[chosen]).astype(np.int64)]
    b = usable[first[chosen] + (rng.random(chosen.shape) * count[chosen]).astype(np.int64)]
    pick = (rng.random(chosen.shape) * candidates.counts[a]).astype(np.int64)
    d_a = candidates.distances[a, pick]
    d_b = candidates.distances[b, np.argmin(np.abs(candidates.distances[b] - d_a[..., None]), axis=2)]
    twists = np.zeros((1 + hypotheses, 6))
    twists_of(np.concatenate([a, b], axis=1), np.concatenate([d_a, d_b], axis=1), J, prior, twists[1:])
    return twists
