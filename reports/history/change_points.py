"""Where a metric changed along the commits: steps, and drift that no single comparison sees.

ruptures proposes the commits at which the level steps (Truong, Oudre & Vayatis 2020; PELT of Killick et al. 2012). Each
stands only when the flights bear it out: the change of every flight across the step is one observation of a Student
test, and the spread of the level between commits bounds it from below, too; the least certain goes first, and what is
left is judged anew. Where a line fits better than a step, and within what is left, the rise of each flight along the
commits is tested in the same way: a drift. A commit of an equal result to the digit is no evidence of anything, so
chance that is drawn once and stays, as with fixed seeds, is judged by the flights alone.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import stdtr

from uavbench.reports.history.series import LEAST_SPREAD, Series
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

ALPHA = 0.0002
"""Two-sided error of one test. A history is looked at after every commit, and a step may be anywhere: so small that of
100 series of 60 commits one at most alarms; measured in docs/history.md."""
PENALTY = 1.0
"""Of a proposed step, in units of noise^2 log n: half of what BIC has, for the flights' test follows."""
LEAST_FLIGHTS = 5
"""With fewer, their spread is no measure: the commits' alone is."""
LEAST_COMMITS = 4
"""Below it there is no noise to measure, and no trend."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change of a series: a step before the commit at `at`, or a drift from `first` through `last`, its end.

    at: index of the first commit of the new level, of a drift that of its last; size: how much worse, as a share of the
    value before, or of all frames; p: of the test.
    """

    kind: Literal["step", "drift"]
    at: int
    first: int
    last: int
    size: float
    p: float


def changes(series: Series, margin: float = 0.01) -> list[Change]:
    """Steps and drifts of at least `margin`, in the order of the commits; UserError without ruptures."""
    n = len(series.commits)
    if n < LEAST_COMMITS:
        return []
    cuts = _without_lines(series, _standing(series, _proposed(series), margin))
    found = [_step(series, start, cut, end) for start, cut, end in _neighbours(cuts, n)]
    for start, end in zip([0, *cuts], [*cuts, n], strict=True):
        if end - start >= LEAST_COMMITS:
            drift = _drift(series, start, end)
            if drift.p <= ALPHA and abs(drift.size) >= margin:
                found.append(drift)
    return sorted(found, key=lambda change: change.at)


def _proposed(series: Series) -> list[int]:
    """Indices at which the level may step, by ruptures."""
    level = series.level
    noise = max(series.noise, LEAST_SPREAD)
    detector = _ruptures().KernelCPD(kernel="linear", min_size=1, jump=1).fit(level[:, None])
    return [int(end) for end in detector.predict(pen=PENALTY * noise**2 * math.log(len(level)))[:-1]]


def _standing(series: Series, cuts: list[int], margin: float) -> list[int]:
    """The proposed steps that stand, the least certain taken out one at a time."""
    ends = [0, *cuts, len(series.commits)]
    steps = [_step(series, *place) for place in _neighbours(cuts, ends[-1])]
    while steps:
        worst = max(range(len(steps)), key=lambda k: (steps[k].p, -abs(steps[k].size)))
        small = next((k for k, step in enumerate(steps) if abs(step.size) < margin), None)
        out = worst if steps[worst].p > ALPHA else small
        if out is None:
            break
        del ends[out + 1], steps[out]
        for k in (out - 1, out):  # only those beside it have other neighbours now
            if 0 <= k < len(steps):
                steps[k] = _step(series, *ends[k : k + 3])
    return ends[1:-1]


def _without_lines(series: Series, cuts: list[int]) -> list[int]:
    """The steps whose neighbourhood a line does not fit better."""
    level, kept = series.level, list(cuts)
    for cut in cuts:
        start, end = max(k for k in [0, *kept] if k < cut), min(k for k in [*kept, len(level)] if k > cut)
        both = level[start:end]
        x = np.arange(len(both))
        if len(both) < 2 * LEAST_COMMITS:
            continue
        line = both - np.polyval(np.polyfit(x, both, 1), x)
        step = np.concatenate([side - side.mean() for side in (level[start:cut], level[cut:end])])
        if line @ line < step @ step:
            kept.remove(cut)
    return kept


def _neighbours(cuts: list[int], n: int) -> list[tuple[int, int, int]]:
    """Start, cut and end of the two levels beside each cut."""
    ends = [0, *cuts, n]
    return list(zip(ends, cuts, ends[2:], strict=False))


def _step(series: Series, start: int, cut: int, end: int) -> Change:
    """The step between the levels [start, cut) and [cut, end)."""
    contrast = np.zeros(len(series.commits))
    contrast[start:cut], contrast[cut:end] = -1.0 / (cut - start), 1.0 / (end - cut)
    size, p = _tested(series, contrast)
    return Change(kind="step", at=cut, first=start, last=end - 1, size=size, p=p)


def _drift(series: Series, start: int, end: int) -> Change:
    """The rise of the line through [start, end)."""
    x = np.arange(end - start) - (end - start - 1) / 2
    contrast = np.zeros(len(series.commits))
    contrast[start:end] = x / (x @ x) * (end - start - 1)
    size, p = _tested(series, contrast)
    return Change(kind="drift", at=end - 1, first=start, last=end - 1, size=size, p=p)


class Tested(NamedTuple):
    """Size of a step, as a share, and its two-sided p."""

    size: float
    p: float


def _tested(series: Series, contrast: Array) -> Tested:
    """Size of a contrast (n,) of the commits, as a share, and its two-sided p."""
    flights, weights = contrast @ series.worse, series.weights
    mean = float(flights @ weights)
    size = mean if series.bigger else math.expm1(mean)
    error = max(series.noise, LEAST_SPREAD if len(weights) < LEAST_FLIGHTS else 0.0) * float(np.linalg.norm(contrast))
    freedom = max(len(contrast) - 2, 1)
    if len(weights) >= LEAST_FLIGHTS:
        among = math.sqrt(float(weights**2 @ (flights - mean) ** 2) * len(weights) / (len(weights) - 1))
        freedom = min(freedom, len(weights) - 1)
        error = max(error, among)
    if error <= 0.0:
        return Tested(size, 0.0 if mean else 1.0)
    return Tested(size, float(2 * stdtr(freedom, -abs(mean) / error)))


def _ruptures() -> Any:
    """The library that finds steps; UserError without it."""
    try:
        import ruptures
    except ImportError:
        raise UserError("finding change points needs ruptures: pip install 'uavbench[history]'") from None
    return ruptures
