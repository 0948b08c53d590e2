"""Steps 8 and 9, low-level multiple hypotheses and RANSAC: which candidate of each control point is the edge.

Every control point keeps several candidates (Teuliere, Marchand & Eck 2010). A hypothesis takes one candidate at two
control points of each of a few edges and moves the camera accordingly; of all hypotheses the one wins whose best set
of candidates, one or none for each control point, has the smallest distance errors.
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
"""Edges in a hypothesis: three lines fix a pose."""
MOTION_COST = 150.0
"""Weight of the camera's motion, in units of the weak prior, against squared distance errors in px: where a pose is
nearly free, as before a single face, the smaller motion wins."""
INLIER_PX = 1.0
"""A candidate farther than this from its moved control point is an outlier."""


@dataclass(frozen=True, eq=False)
class Matches:
    """The set that won: the distance (n,) of each control point's candidate, and whether it is an inlier (n,)."""

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
    """The winning set over candidates of control points with Jacobians J (n, 6) on edges `edge` (n,)."""
    twists = _hypothesis_twists(candidates, J, edge, prior, rng, hypotheses)
    motion = MOTION_COST * np.einsum("hi,hi->h", twists @ prior, twists)
    twist = twists[cheapest(twists, motion, J, candidates.distances, inlier_px)]
    matches = best_set(candidates.distances, J @ twist, inlier_px)
    for _ in range(2):  # the winner is improved on its own inliers (Chum, Matas & Kittler 2003)
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
    """Camera motions (h, 6), the first of them none."""
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
