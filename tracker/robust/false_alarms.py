"""Is the structure there by chance? The number of false alarms of the edges found (Desolneux, Moisan & Morel 2000).

Background model: on a search line with m candidates laid at random one lies within the width of the M-estimator with
probability 1 - (1 - width / half length)^m. The line's own candidates are counted, so that a cluttered image, where
chance finds much, asks for more. Points of one part of an edge are found or missed together: parts are counted.
"""

import math

import numpy as np

from uavbench.tracker.robust.pose_fit import Fit
from uavbench.trajectories.pose import Array


def log10_false_alarms(fit: Fit, width_px: float, half_px: float, tests: int) -> float:
    """Decimal logarithm of the number of poses, of so many tested, at which chance finds as many parts of edges.

    An upper bound, by Chernoff's bound of the binomial tail; width_px of the weights, half_px of the search lines.
    """
    if fit.residuals is None or not len(fit.residuals.points.rows):
        return math.log10(tests)
    rows, weight = fit.residuals.points.rows, fit.residuals.weighting.weight
    candidates = np.count_nonzero(np.isfinite(fit.residuals.candidates_px), axis=1)
    by_chance = 1.0 - (1.0 - width_px / half_px) ** candidates
    _, part, count = np.unique(rows, return_inverse=True, return_counts=True)
    found = np.bincount(part, weight > 0) / count
    expected = np.bincount(part, by_chance) / count
    return math.log10(tests) + log10_tail(found, expected)


def log10_tail(found: Array, expected: Array) -> float:
    """Bound of the probability that as large a share (n,) is found where that much (n,) is expected, as log10."""
    share, chance = float(found.mean()), float(expected.mean())
    if share <= chance:
        return 0.0
    if chance == 0.0:
        return -math.inf
    missed = (1 - share) * math.log((1 - share) / (1 - chance)) if share < 1.0 else 0.0
    return -len(found) * (share * math.log(share / chance) + missed) / math.log(10)
