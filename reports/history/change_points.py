"""Change points of a metric along the commits: steps, and drifts too slow for a comparison of two commits.

ruptures proposes the commits at which the level steps (Truong, Oudre & Vayatis 2020; PELT of Killick et al. 2012). A
step is kept only when the test over flights supports it (`evidence`); the least significant is removed first, and the
others are tested again. Where a line fits as well as a step, and within each remaining segment, the slope over the
commits is tested in the same way: a drift. A commit that repeats a result to the digit is not counted as evidence.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from uavbench.reports.history.evidence import tested
from uavbench.reports.history.series import LEAST_SPREAD, Series
from uavbench.trajectories.errors import UserError

ALPHA = 0.00005
"""Two-sided error of one test. A history is tested after every commit, and a step may be anywhere: small enough that
at most one of 100 series of 40 commits raises a false alarm, also with outliers; measured in docs/history.md."""
PENALTY = 1.0
"""Penalty of a proposed step, in units of noise^2 log n: half that of BIC, because the test over flights follows."""
SETTLED = 4
"""Fewest commits of a new level where commits differ by chance: a single bad commit is not a step."""
LEAST_COMMITS = 4
"""Fewest commits from which noise can be estimated and changes are tested."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change of a series: a step at the commit `at`, or a drift from `first` to `last`; all are indices of commits.

    at: the first commit of a step's new level, or a drift's last commit; first, last: the commits of both levels, or of
    the drift; size: relative change of an error, or change in the share of frames or flights, positive for worse; p:
    two-sided.
    """

    kind: Literal["step", "drift"]
    at: int
    first: int
    last: int
    size: float
    p: float


def changes(series: Series, margin: float = 0.01) -> list[Change]:
    """Steps and drifts of a size of at least `margin`, in the order of the commits.

    UserError when ruptures is not installed.
    """
    n = len(series.commits)
    if n < LEAST_COMMITS:
        return []
    cuts = _without_lines(series, _standing(series, _proposed(series), margin))
    found = [_step(series, *place, cuts) for place in _neighbours(cuts, n)]
    for start, end in zip([0, *cuts], [*cuts, n], strict=True):
        if end - start >= LEAST_COMMITS:
            drift = _drift(series, start, end, cuts)
            if drift.p <= ALPHA and abs(drift.size) >= margin:
                found.append(drift)
    return sorted(found, key=lambda change: change.at)


def _proposed(series: Series) -> list[int]:
    """Indices of the commits at which ruptures finds a step of the level."""
    level = series.level
    least = SETTLED if series.noisy else 1
    if len(level) < 2 * least:
        return []
    detector = _ruptures().KernelCPD(kernel="linear", min_size=least, jump=1).fit(level[:, None])
    return [int(end) for end in detector.predict(pen=_penalty(series))[:-1]]


def _penalty(series: Series) -> float:
    """Penalty of a step, in squared units of the level."""
    return PENALTY * max(series.noise, LEAST_SPREAD) ** 2 * math.log(len(series.commits))


def _standing(series: Series, cuts: list[int], margin: float) -> list[int]:
    """The proposed steps that are significant and large enough; the least significant are removed one at a time."""
    ends = [0, *cuts, len(series.commits)]
    steps = [_step(series, *place, cuts) for place in _neighbours(cuts, ends[-1])]
    while steps:
        worst = max(range(len(steps)), key=lambda k: (steps[k].p, -abs(steps[k].size)))
        small = next((k for k, step in enumerate(steps) if abs(step.size) < margin), None)
        out = worst if steps[worst].p > ALPHA else small
        if out is None:
            break
        del ends[out + 1], steps[out]
        for k in (out - 1, out):  # only the adjacent steps have new neighbours
            if 0 <= k < len(steps):
                start, cut, end = ends[k : k + 3]
                steps[k] = _step(series, start, cut, end, ends[1:-1])
    return ends[1:-1]


def _without_lines(series: Series, cuts: list[int]) -> list[int]:
    """The steps around which a line fits worse; the penalty accounts for the free position of a step."""
    level, kept = series.level, list(cuts)
    for cut in cuts:
        start, end = max(k for k in [0, *kept] if k < cut), min(k for k in [*kept, len(level)] if k > cut)
        both = level[start:end]
        x = np.arange(len(both))
        if len(both) < 2 * LEAST_COMMITS:
            continue
        line = both - np.polyval(np.polyfit(x, both, 1), x)
        step = np.concatenate([side - side.mean() for side in (level[start:cut], level[cut:end])])
        if line @ line < step @ step + _penalty(series):
            kept.remove(cut)
    return kept


def _neighbours(cuts: list[int], n: int) -> list[tuple[int, int, int]]:
    """Start, cut and end of the two levels that each cut separates."""
    ends = [0, *cuts, n]
    return list(zip(ends, cuts, ends[2:], strict=False))


def _step(series: Series, start: int, cut: int, end: int, cuts: list[int]) -> Change:
    """The step between the levels [start, cut) and [cut, end); cuts: all steps of the series."""
    contrast = np.zeros(len(series.commits))
    contrast[start:cut], contrast[cut:end] = -1.0 / (cut - start), 1.0 / (end - cut)
    size, p = tested(series, contrast, cuts)
    return Change(kind="step", at=cut, first=start, last=end - 1, size=size, p=p)


def _drift(series: Series, start: int, end: int, cuts: list[int]) -> Change:
    """The drift over the commits [start, end): the rise of the fitted line from first to last."""
    x = np.arange(end - start) - (end - start - 1) / 2
    contrast = np.zeros(len(series.commits))
    contrast[start:end] = x / (x @ x) * (end - start - 1)
    size, p = tested(series, contrast, cuts)
    return Change(kind="drift", at=end - 1, first=start, last=end - 1, size=size, p=p)


def _ruptures() -> Any:
    """The module ruptures; UserError when it is not installed."""
    try:
        import ruptures
    except ImportError:
        raise UserError("finding change points needs ruptures: pip install 'uavbench[history]'") from None
    return ruptures
