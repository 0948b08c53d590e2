"""Number of false alarms of the edges and patches found, a test against chance (Desolneux, Moisan & Morel 2000).

Background model: on a search line with m random candidates at least one is within the cutoff of the M-estimator with
probability 1 - (1 - width / half length)^m. m is counted on each line, so that more edges are required in cluttered
images, which match by chance. Points of one part of an edge are found or missed together, so parts are counted. A
patch is found as easily as an edge with one candidate.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class Chance(NamedTuple):
    """Decimal logarithms of bounds on the probability that a random pose finds as much: of the edges alone, and of
    edges or edges and patches together, whichever is less likely.
    """

    edges: float
    whole: float


@compiled("f0 f0 i0", inner=True)
def log10_tail(found: float, expected: float, n: int) -> float:
    """log10 of Chernoff's bound on the probability that so many or more of n are found, where `expected` are."""
    if found <= expected:
        return 0.0
    if expected <= 0.0:
        return -math.inf
    bound = found * math.log(found / expected)
    if found < n:
        bound += (n - found) * math.log((n - found) / (n - expected))
    return min(0.0, -bound / math.log(10.0))


@compiled("i1 f2 f1 f1 f1 f0 f0")
def chance(
    rows: Indices,
    distance: Array,
    weight: Array,
    patch_weight: Array,
    correlation: Array,
    width_px: float,
    half_px: float,
) -> Chance:
    """Bounds on the probability that a random pose finds as many parts of edges, and patches.

    rows (n,), equal for the points of one part; distance (n, k) of the candidates in px, inf where none; weight (n,)
    and patch_weight (m,) > 0 for inliers; correlation (m,) < 0 for patches that were not searched; width_px: cutoff of
    the weights; half_px: half length of the search lines.
    """
    parts, share, expected, p = 0, 0.0, 0.0, 0
    while p < len(rows):
        first, found, by_chance = p, 0, 0.0
        while p < len(rows) and rows[p] == rows[first]:
            candidates = 0
            for k in range(distance.shape[1]):
                candidates += int(distance[p, k] < np.inf)
            by_chance += 1.0 - (1.0 - width_px / half_px) ** candidates
            found += int(weight[p] > 0.0)
            p += 1
        parts, share, expected = parts + 1, share + found / (p - first), expected + by_chance / (p - first)
    edges = log10_tail(share, expected, parts)
    for i in range(len(correlation)):
        if correlation[i] >= 0.0:
            parts, expected = parts + 1, expected + width_px / half_px
            share += 1.0 if patch_weight[i] > 0.0 else 0.0
    whole = log10_tail(share, expected, parts)
    return Chance(edges, min(0.0, min(edges, whole) + math.log10(2.0)))
