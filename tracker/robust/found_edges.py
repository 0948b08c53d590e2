"""The edges that the frames of a run show, and what a fit lacks of them."""

from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import EDGE
from uavbench.tracker.robust.fit.learning import MIN_POINTS
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.trajectories.pose import Array

LEAST_EXPECTED = 2 * MIN_POINTS
"""Expected control points of which it is asked whether they are found: of fewer, an edge or two are most."""
MOST_MISSING = 0.3
"""Share of the expected control points that the fit of a track may lack where patches do not vouch for it.

Measured on 20 flights at 15 and 5 Hz: up to 0.32 in 999 of 1,000 frames at the right pose, 0.40 to 0.47 where a pose
slid to other lines. With 0.2 a building behind trees has a pose in 23 of 527 frames less, with 0.3 in 5.
"""


class Counts(NamedTuple):
    """Numbers (e,) of the control points of a fit on each edge of a structure, and of those that it found."""

    points: Array
    found: Array


class FoundEdges:
    """What part of its control points was found on each edge of a structure in the frames before: a running mean.

    An edge that was there is there again in the next frame, unless something hides it. A pose that slid to other lines
    finds as much as before, but no longer the same.
    """

    def __init__(self, edges: int, rate: float) -> None:
        self.part, self.rate = np.empty(edges), rate
        self.forget()

    def forget(self) -> None:
        """Expect no edge."""
        self.part[:] = np.nan

    def missing(self, fit: Fit) -> float:
        """Share of the expected control points that a fit did not find; 0 where few are expected, or it has none."""
        points, found = counts(fit, len(self.part))
        known = (points > 0) & np.isfinite(self.part)
        expected = points[known] * self.part[known]
        if expected.sum() < LEAST_EXPECTED:
            return 0.0
        return float(np.maximum(expected - found[known], 0.0).sum() / expected.sum())

    def learn(self, fit: Fit) -> None:
        """Expect what an accepted fit found."""
        points, found = counts(fit, len(self.part))
        seen = points > 0
        part, before = found[seen] / points[seen], self.part[seen]
        self.part[seen] = np.where(np.isnan(before), part, before + self.rate * (part - before))


def counts(fit: Fit, edges: int) -> Counts:
    """What a fit found of a structure of so many edges."""
    if fit.searched is None:
        return Counts(np.zeros(edges), np.zeros(edges))
    edge = fit.searched.problem.points.keys[:, EDGE]
    found = edge[fit.searched.found.estimate.weighting.weight > 0.0]
    return Counts(*(np.bincount(each, minlength=edges).astype(float) for each in (edge, found)))
