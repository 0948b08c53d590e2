"""One metric of one tracker along the commits of a history, flight by flight.

Changes are measured per flight, relative to the flight's own level, which removes the differences between flights: they
are far larger than changes between commits. Metrics for which smaller is better enter as logarithms, so that changes
are relative; the others enter as minus their value, a share of all frames or flights.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavbench.reports.history.history_file import Commit, History, Recorded
from uavbench.trajectories.pose import Array

AT_MOST = 0.19
"""Winsorization limit of one flight's deviation from the commit's median, in logs: twice a change of 10 %, as in the
gate; a single outlier can neither hide nor imitate a change of all flights."""
LEAST_ERROR = 1e-12
"""Resolution in the unit of the metric: smaller values count as equal, as in the gate."""
STEADY = 0.5
"""Floor of a flight's spread between commits, as a fraction of the median spread: few commits estimate it poorly."""
STEPS = 0.3
"""Share of a flight's differences between commits, the largest, that do not count as its spread: changes that few
commits made, and that stay, would take the weight from the very flights that they are of."""
LEAST_SPREAD = 0.002
"""Spread of a flight between commits, in logs or shares, below which flights have equal weights."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A tracker's metric along n commits.

    commits: those with a value, in order; value, low, high (n,): as recorded, in `unit`; worse (n, flights): deviation
    of each flight from its own median, positive for worse, in logs or shares, winsorized around the commit's median;
    weights (flights,): sum to 1, larger for flights with less spread between commits.
    """

    tracker: str
    metric: str
    unit: str
    bigger: bool
    commits: list[Commit]
    value: Array
    low: Array
    high: Array
    worse: Array
    weights: Array

    @property
    def name(self) -> str:
        """`robust@15hz ATE`."""
        return f"{self.tracker} {self.metric}"

    @property
    def level(self) -> Array:
        """Weighted mean deviation (n,) of each commit, positive for worse, in logs or shares."""
        level: Array = self.worse @ self.weights
        return level

    @property
    def noisy(self) -> bool:
        """Whether most commits differ from the previous one by chance; with fixed seeds most repeat its results."""
        return self.noise > LEAST_SPREAD

    @property
    def noise(self) -> float:
        """Standard deviation of the level between equivalent commits, from differences of neighbours."""
        return spread(self.level)


def all_series(history: History) -> list[Series]:
    """Series of every tracker and metric, sorted by name; those without any finite value are left out."""
    names = sorted({(run, metric) for c in history.commits for run, of in c.metrics.items() for metric in of})
    return [series for run, metric in names if (series := series_of(history, run, metric))]


def series_of(history: History, tracker: str, metric: str) -> Series | None:
    """A tracker's metric along the commits that have a finite value of it; None when none has."""
    have = [c for c in history.commits if (r := c.metrics.get(tracker, {}).get(metric)) and _has_number(r)]
    if not have:
        return None
    recorded = [c.metrics[tracker][metric] for c in have]
    bigger = recorded[-1].better == "bigger"
    worse = flights_worse(recorded, bigger=bigger)
    return Series(
        tracker=tracker, metric=metric, unit=recorded[-1].unit, bigger=bigger, commits=have,
        **{name: np.array([getattr(r, name) for r in recorded], dtype=float) for name in ("value", "low", "high")},
        worse=worse, weights=weights_of(worse),
    )  # fmt: skip


def flights_worse(recorded: list[Recorded], *, bigger: bool) -> Array:
    """Deviation (n, flights) of each flight from its own median, positive for worse, in logs or shares.

    A missing value counts as the commit's median for errors, and as the flight's own for shares.
    """
    keys = sorted({key for each in recorded for key, _ in _flights(each)})
    table = [dict(_flights(each)) for each in recorded]
    values = np.array([[row.get(key, np.nan) for key in keys] for row in table], dtype=float)
    values = -values if bigger else np.log(np.maximum(values, LEAST_ERROR))
    values = values[:, np.isfinite(values).any(axis=0)]
    apart = values - np.nanmedian(values, axis=0)
    if bigger:
        filled: Array = np.nan_to_num(apart)
        return filled
    common = np.nanmedian(apart, axis=1, keepdims=True)
    limited: Array = common + np.clip(np.nan_to_num(apart - common), -AT_MOST, AT_MOST)
    return limited


def weights_of(worse: Array) -> Array:
    """Weights (flights,) that sum to 1, by inverse variance between commits (n, flights) with a floor of STEADY.

    The largest differences, a share STEPS of all, are left out. A flight with the median spread has a fifth of the
    weight of one without spread.
    """
    squares = np.sort(np.diff(worse, axis=0, prepend=worse[:1]) ** 2, axis=0)
    kept = len(worse) - math.ceil(STEPS * (len(worse) - 1))
    spreads = np.sqrt(np.mean(squares[:kept], axis=0) / 2)
    usual = STEADY * max(float(np.median(spreads)), LEAST_SPREAD)
    precision = 1.0 / (spreads**2 + usual**2)
    weights: Array = precision / precision.sum()
    return weights


def spread(values: Array) -> float:
    """Robust standard deviation of values (n,) about a piecewise constant level, by the median difference."""
    if len(values) < 2:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values))) / np.sqrt(2))


def _has_number(recorded: Recorded) -> bool:
    return recorded.value is not None and any(np.isfinite(value) for _, value in _flights(recorded))


def _flights(recorded: Recorded) -> Iterator[tuple[tuple[str, int], float]]:
    for sequence, seeds in recorded.runs.items():
        for seed, value in enumerate(seeds):
            yield (sequence, seed), np.nan if value is None else value
