"""The edges that the frames of a run show, and what a fit lacks of them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import EDGE
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS, Fit
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LEAST_EXPECTED = 2 * MIN_POINTS
"""Expected control points of which it is asked whether they are found: of fewer, an edge or two are most."""
MOST_MISSING = 0.3
"""Share of the expected control points that the fit of a track may lack where patches do not vouch for it.

Measured on 20 flights at 15 and 5 Hz: up to 0.32 in 999 of 1,000 frames at the right pose, 0.40 to 0.47 where a pose
slid to other lines. With 0.2 a building behind trees has a pose in 23 of 527 frames less, with 0.3 in 5.
"""
STILL_MISSING = 0.2
"""The same after a frame in which more were missing. Measured on a wall of windows cut to 360 x 270 px: 0.15 to 0.26
are missing in the frames after a pose slid. With 0.15 in place of 0.2 four more views were the same, but for one pose.
"""


class Counts(NamedTuple):
    """Number of the control points of a fit on an edge, and of those that it found; until: the point after the last."""

    points: float
    found: float
    until: int


@compiled("i2! f1! i0", inner=True, allocates=False)
def counts(keys: Indices, weight: Array, first: int) -> Counts:
    """What a fit shows of the edge of its control point `first`, with keys (n, 3) by edges; found with weight (n,)."""
    found, until = 0.0, first
    while until < len(keys) and keys[until, EDGE] == keys[first, EDGE]:
        found += 1.0 if weight[until] > 0.0 else 0.0
        until += 1
    return Counts(float(until - first), found, until)


@compiled("f0 f0", inner=True, allocates=False)
def missing_by_chance(points: float, part: float) -> float:
    """Mean number of points that are found too few of an edge where each is found with a probability `part`.

    It is half of the mean deviation of a binomial distribution (de Moivre 1730, in Diaconis & Zabell 1991).
    """
    if not 0.0 < part < 1.0:
        return 0.0
    above = math.floor(points * part) + 1.0
    ways = math.lgamma(points + 1.0) - math.lgamma(above + 1.0) - math.lgamma(points - above + 1.0)
    return above * math.exp(ways + above * math.log(part) + (points - above + 1.0) * math.log(1.0 - part))


@compiled("i2! f1! f1!")
def missing_share(keys: Indices, weight: Array, part: Array) -> float:
    """Share of the points expected by the part (e,) of each edge that was not found; 0 where few are expected.

    What chance leaves out of edges that were found in part is neither expected nor missing.
    """
    expected, sure, left, p = 0.0, 0.0, 0.0, 0
    while p < len(keys):
        usual = part[keys[p, EDGE]]
        points, found, p = counts(keys, weight, p)
        if np.isfinite(usual):
            of_edge, by_chance = points * usual, missing_by_chance(points, usual)
            expected += of_edge
            sure += of_edge - by_chance
            left += max(of_edge - found, 0.0) - by_chance
    return max(0.0, left / sure) if expected >= LEAST_EXPECTED else 0.0


@compiled("i2! f1! f1! f0")
def learn_parts(keys: Indices, weight: Array, part: Array, rate: float) -> None:
    """Update the part (e,) of each edge, in place, with what was found of it: a running mean."""
    p = 0
    while p < len(keys):
        e = keys[p, EDGE]
        points, found, p = counts(keys, weight, p)
        now = found / points
        part[e] = now if np.isnan(part[e]) else part[e] + rate * (now - part[e])


class FoundEdges:
    """What part of its control points was found on each edge of a structure in the frames before: a running mean.

    An edge that was there is there again in the next frame, unless something hides it. A pose that slid to other lines
    finds as much as before, but no longer the same.
    """

    def __init__(self, edges: int, rate: float) -> None:
        self.part, self.rate, self.slid = np.empty(edges), rate, False
        self.forget()

    def forget(self) -> None:
        """Expect no edge."""
        self.part[:] = np.nan

    def has_slid(self, fit: Fit, again: bool) -> bool:
        """Whether a track's fit lacks many edges that were found just before, and hardly a patch is where it has to be.

        again: whether the edges are to be found again; after a long interval they may be hidden, and a search compares
        poses. A track that slid has to find more of them again: edges of where it slid to come into view meanwhile, and
        are expected nowhere.
        """
        most, self.slid = STILL_MISSING if self.slid else MOST_MISSING, False
        if again and fit.residuals is not None:
            patches = int(np.count_nonzero(fit.residuals.weighting.patch_weight))
            self.slid = patches < MIN_POINTS and self.missing(fit) > most
        return self.slid

    def missing(self, fit: Fit) -> float:
        """Share of the expected control points that a fit did not find; 0 where few are expected, or it has none."""
        if fit.searched is None:
            return 0.0
        found = fit.searched.found
        return unchecked(missing_share)(found.measured.points.keys, found.estimate.weighting.weight, self.part)

    def learn(self, fit: Fit) -> None:
        """Expect what an accepted fit found."""
        if fit.searched is None:
            return
        found = fit.searched.found
        unchecked(learn_parts)(found.measured.points.keys, found.estimate.weighting.weight, self.part, self.rate)
