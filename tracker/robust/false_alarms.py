"""Number of false alarms of the edges found, a test against chance (Desolneux, Moisan & Morel 2000).

Background model: on a search line with m random candidates at least one is within the cutoff of the M-estimator with
probability 1 - (1 - width / half length)^m. m is counted on each line, so that more edges are required in cluttered
images, which match by chance. Points of one part of an edge are found or missed together, so parts are counted.
"""

import math

import numpy as np

from uavbench.tracker.robust.pose_fit import Fit
from uavbench.trajectories.pose import Array


def log10_false_alarms(fit: Fit, width_px: float, half_px: float, tests: int) -> float:
    """Decimal logarithm of the expected number of `tests` random poses at which as many parts of edges are found.

    An upper bound, by Chernoff's bound of the binomial tail. width_px: cutoff of the weights; half_px: half length of
    the search lines.
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
    """log10 of a bound on the probability of finding a fraction (n,) or more, given its expectation (n,)."""
    share, chance = float(found.mean()), float(expected.mean())
    if share <= chance:
        return 0.0
    if chance == 0.0:
        return -math.inf
    missed = (1 - share) * math.log((1 - share) / (1 - chance)) if share < 1.0 else 0.0
    return -len(found) * (share * math.log(share / chance) + missed) / math.log(10)
