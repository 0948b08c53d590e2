"""One metric of one tracker along the commits of a history, flight by flight.

Changes are measured on the flights themselves, each against its own level: what differs between flights, far more than
what changes with a commit, is out of them. A value that is better when smaller counts as its logarithm, so that a
change is a share; one that is better when bigger as its loss, in shares of all frames or flights.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavbench.reports.history.history_file import Commit, History, Recorded
from uavbench.trajectories.pose import Array

AT_MOST = 0.19
"""Limit of how far one flight counts beyond the others, in logs: twice a change of 10 %, as the gate's typical change
has it; a run that slips by chance cannot hide, nor feign, a change of all."""
LEAST_ERROR = 1e-12
"""Resolution in the unit of the metric: smaller values count as equal, as in the gate."""
STEADY = 0.5
"""Of the usual spread of flights between commits: the spread of a steady one, which few commits could feign."""
LEAST_SPREAD = 0.002
"""Spread of a flight between commits, in logs or shares, below which flights count alike."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A tracker's metric along n commits.

    commits: those that have it, in their order; value, low, high (n,): as recorded; worse (n, flights): how much worse
    each flight is than its own median, in logs of the value or in shares, limited around the commit's median; weights
    (flights,): sum to 1, by how steady a flight is between commits.
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
        """How much worse each commit is than usual (n,), in logs or shares."""
        level: Array = self.worse @ self.weights
        return level

    @property
    def noisy(self) -> bool:
        """Whether most commits differ from the one before, by chance; with fixed seeds most repeat it."""
        return self.noise > LEAST_SPREAD

    @property
    def noise(self) -> float:
        """Standard deviation of the level between commits that change nothing, from the differences of neighbours."""
        return spread(self.level)


def all_series(history: History) -> list[Series]:
    """Every tracker's metrics, in the order of the names; those without any number are left out."""
    names = sorted({(run, metric) for c in history.commits for run, of in c.metrics.items() for metric in of})
    return [series for run, metric in names if (series := series_of(history, run, metric))]


def series_of(history: History, tracker: str, metric: str) -> Series | None:
    """A tracker's metric along the commits that have a number of it; None where none has."""
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
    """How much worse each flight is than its own median (n, flights); what has no number is as the commit's median."""
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
    """Weights of the flights (flights,) that sum to 1: one as unsteady as most counts a fifth of a steady one."""
    spreads = np.sqrt(np.mean(np.diff(worse, axis=0, prepend=worse[:1]) ** 2, axis=0) / 2)
    usual = STEADY * max(float(np.median(spreads)), LEAST_SPREAD)
    precision = 1.0 / (spreads**2 + usual**2)
    weights: Array = precision / precision.sum()
    return weights


def spread(values: Array) -> float:
    """Standard deviation of values (n,) about levels that change seldom, from the differences of neighbours."""
    if len(values) < 2:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values))) / np.sqrt(2))


def _has_number(recorded: Recorded) -> bool:
    return recorded.value is not None and any(np.isfinite(value) for _, value in _flights(recorded))


def _flights(recorded: Recorded) -> Iterator[tuple[tuple[str, int], float]]:
    for sequence, seeds in recorded.runs.items():
        for seed, value in enumerate(seeds):
            yield (sequence, seed), np.nan if value is None else value
