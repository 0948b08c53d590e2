"""Size and significance of a contrast of a series' commits, by Student's test.

The variance is estimated in three ways, and the largest is used. The noise of the flights, each from differences of
neighbouring commits, is well known after few commits. The noise of the level includes what flights have in common. The
spread of the contrast over flights includes what stays fixed after one commit, as with fixed seeds. Where both of
these agree with the flights' noise, its degrees of freedom are used, otherwise theirs, which are few.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, stdtr

from uavbench.reports.history.series import LEAST_SPREAD, Series
from uavbench.trajectories.pose import Array

LEAST_FLIGHTS = 5
"""Fewest flights whose spread is used; with fewer, only the noise between commits is."""
SAME = 1e-9
"""Difference in logs or shares below which a commit repeats the result of a flight: a history has six digits."""
SHARED = 2 / 3
"""Degrees of freedom per difference of neighbours: each value is part of two differences (von Neumann 1941)."""
USUAL = 3.0
"""Weight, in differences, of the mean noise of all flights in the estimate for one flight."""
LEAST_FREEDOM = 12.0
"""Fewest degrees of freedom to test agreement: with fewer, any two estimates would agree."""
RARE = 0.1
"""One-sided level of the chi-square test of agreement."""


@dataclass(frozen=True)
class Variance:
    """An estimate of the variance of a contrast, and its degrees of freedom."""

    value: float
    freedom: float

    def agrees(self, known: "Variance") -> bool:
        """Whether it is not significantly larger than a well-known variance."""
        enough = self.freedom >= LEAST_FREEDOM
        return enough and self.value * self.freedom <= known.value * float(chdtri(self.freedom, RARE))


class Tested(NamedTuple):
    """Size of a change, as a share, and its two-sided p."""

    size: float
    p: float


def tested(series: Series, contrast: Array, cuts: list[int]) -> Tested:
    """Size of a contrast (n,) of the commits, relative or as a share, and its two-sided p.

    cuts: indices of the commits at which the level steps; their differences to the previous commits are not noise.
    """
    flights, weights = contrast @ series.worse, series.weights
    mean = float(flights @ weights)
    size = mean if series.bigger else math.expm1(mean)
    noise = _of_noise(series, contrast, cuts)
    others = list(_others(series, contrast, cuts, flights - mean))
    error = math.sqrt(max(each.value for each in (noise, *others)))
    agreed = len(others) > 1 and all(each.agrees(noise) for each in others)
    freedom = noise.freedom if agreed else min(each.freedom for each in others)
    if error <= 0.0:
        return Tested(size, 0.0 if mean else 1.0)
    return Tested(size, float(2 * stdtr(freedom, -abs(mean) / error)))


def _of_noise(series: Series, contrast: Array, cuts: list[int]) -> Variance:
    """Variance by the noise of each flight; a commit that repeats a flight to the digit is not an independent draw."""
    n, flights = series.worse.shape
    steps = np.diff(series.worse, axis=0)
    moved = np.abs(steps) > SAME
    drawn = moved.copy()
    drawn[[cut - 1 for cut in cuts]] = False
    counts, squares = drawn.sum(axis=0), (steps**2 * drawn).sum(axis=0) / 2
    usual = squares.sum() / max(int(counts.sum()), 1)
    draws = np.vstack([np.zeros(flights, dtype=np.int64), moved.cumsum(axis=0)]) + n * np.arange(flights)
    together = np.bincount(draws.ravel(), weights=np.repeat(contrast, flights), minlength=n * flights)
    own = (squares + USUAL * usual) / (counts + USUAL)
    parts = series.weights**2 * own * (together.reshape(flights, n) ** 2).sum(axis=1)
    value = float(parts.sum())
    if value <= 0.0:
        return Variance(0.0, 0.0)
    return Variance(value, value**2 / float((parts**2 / (SHARED * np.maximum(counts, 1))).sum()))


def _others(series: Series, contrast: Array, cuts: list[int], apart: Array) -> Iterator[Variance]:
    """Variances from the noise of the level, if commits differ, and from the spread over flights, if enough."""
    norm, weights = float(contrast @ contrast), series.weights
    if series.noisy:
        steps = np.delete(np.diff(series.level), [cut - 1 for cut in cuts])
        yield Variance(norm * float(np.mean(steps**2)) / 2 if len(steps) else 0.0, max(SHARED * len(steps), 1.0))
    if len(weights) >= LEAST_FLIGHTS:
        spare = len(weights) - 1
        yield Variance(float(weights**2 @ apart**2) * len(weights) / spare, spare)
    else:
        yield Variance(norm * LEAST_SPREAD**2, max(len(contrast) - 2.0, 1.0))
