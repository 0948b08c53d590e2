"""Mean and spread of each tracker over its runs, and paired tests between trackers."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np

from uavbench.reports.json_values import json_values
from uavbench.reports.many_runs.evaluate_many import METRICS, EvaluatedRun, ManyRuns
from uavbench.reports.statistics.bootstrap import (
    Comparison,
    Interval,
    compare_each,
    hierarchical_interval,
    least_units,
)
from uavbench.reports.tables.columns import Column
from uavbench.reports.tables.summary_table import KEEPS_UP, Cell, Table
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Mean over runs with its interval, their standard deviation (ddof 1; None for a single run), and their extremes.

    The unit is that of the values.
    """

    mean: Interval
    std: float | None
    least: float
    most: float

    @classmethod
    def of(cls, values: Array) -> "Spread | None":
        """Spread of the finite values (n,) of runs; None without any."""
        known = values[np.isfinite(values)]
        if not len(known):
            return None
        return cls(
            mean=hierarchical_interval([known]),
            std=float(known.std(ddof=1)) if len(known) > 1 else None,
            least=float(known.min()),
            most=float(known.max()),
        )

    def to_json(self) -> dict[str, Any]:
        """JSON object with NaN as null."""
        return {**json_values(asdict(self.mean)), "std": self.std, "min": self.least, "max": self.most}


def comparisons(many: ManyRuns) -> dict[str, list[Comparison]]:
    """Every pair of trackers by each of METRICS (m, deg) on the paired runs, p adjusted by Holm over the pairs.

    Each pair is compared over the frames that both have: the errors of one that is lost where it is difficult are lower
    otherwise. Pairs that share no frame in one of the runs are left out; empty when no runs are paired.
    """
    pairs = list(combinations(many.pairs.rows, 2))
    found = {metric: [many.paired(metric, pair) for pair in pairs] for metric in METRICS}
    tested = {metric: [_one_truth(each) for each in values if each] for metric, values in found.items()}
    return {metric: compare_each(values) for metric, values in tested.items() if values}


def frames_of(many: ManyRuns, tested: Mapping[str, list[Comparison]]) -> str:
    """Over which frames two trackers are compared, and which could not be, as the end of a sentence; "" without pairs.

    tested: as `comparisons` returns them.
    """
    if not many.pairs.rows:
        return ""
    left = ""
    for metric, what, shared in (("ate_position", "ATE", "frame"), ("rpe_position", "RPE", "interval")):
        done = {(c.first, c.second) for c in tested.get(metric, [])}
        pairs = [f"{a} - {b}" for a, b in combinations(many.pairs.rows, 2) if (a, b) not in done]
        if pairs:
            left += f"; no test of the {what} of {', '.join(pairs)}, which share no {shared} in one of these runs"
    return f", over the frames for which both trackers have a pose{left}"


def _one_truth(values: Mapping[str, Array]) -> dict[str, list[Array]]:
    """Values as arguments of the statistics: the runs of a single sequence."""
    return {name: [v] for name, v in values.items()}


EXTRA = (
    Column(head="coverage", key="coverage", scale=100, unit="%", best="max", decimals=1),
    Column(head="NEES", key="nees", unit="expected 6", best="", decimals=2),
    Column(head="NEES, aligned", key="nees_aligned", unit="expected 6", best="", decimals=2),
)


ROUND_OFF = 1e-9
"""Fraction of a metric's largest error below which a value counts as round-off."""
BOLD = (
    "Bold: best of its column, ties included; none where a run has no value, or it is of a tracker with less than "
    f"{KEEPS_UP:.0%} of the best coverage."
)
"""Part of the caption of a table with bold cells."""


def extra(run: EvaluatedRun, key: str) -> float:
    """A measure of a run that is reported but not tested, by key of EXTRA; NaN where there is none."""
    if key == "coverage":
        return run.coverage
    found = run.nees and (run.nees.before if key == "nees" else run.nees.after)
    return float("nan") if not found or found.mean is None else found.mean


def summary(many: ManyRuns, tested: Mapping[str, list[Comparison]]) -> Table:
    """Table with a row per tracker: means with 95 % intervals, and standard deviations, over its runs.

    tested: as `comparisons` returns them.
    """
    columns = [Column(head="runs", key="runs", unit="", best="", decimals=0), EXTRA[0]]
    rows: dict[str, list[Cell]] = {
        name: [_plain(len(group), 0), _plain(100 * np.mean([run.coverage for run in group]).item(), EXTRA[0].decimals)]
        for name, group in many.groups.items()
    }
    for metric, about in METRICS.items():
        decimals = decimals_of(about.scale * np.concatenate(list(many.values(metric).values())))
        mean = Column(head=about.name, key=metric, scale=about.scale, unit=about.unit, best="min", decimals=decimals)
        spread = Column(head=f"{about.name} sd", key=metric, unit=about.unit, best="", decimals=mean.decimals)
        columns += [mean, spread]
        best = _best(many, mean)
        for name, values in many.values(metric).items():
            won, known = name in best, Spread.of(about.scale * values)
            rows[name] += [
                _mean(values, mean, won, [name] == best and _stands(name, tested.get(metric, []), len(rows) - 1)),
                _plain(known.std if known else None, mean.decimals),
            ]
    for column in EXTRA[1:]:
        found = {name: [extra(run, column.key) for run in group] for name, group in many.groups.items()}
        if any(np.isfinite(v).any() for v in found.values()):
            columns.append(column)
            for name, of_group in found.items():
                rows[name].append(_mean(of_group, column))
    return Table(caption(many, tested), tuple(columns), tuple((name, tuple(cells)) for name, cells in rows.items()))


def caption(many: ManyRuns, tested: Mapping[str, list[Comparison]]) -> str:
    """Caption of the table: ground truth, alignment, intervals, and tests."""
    record = many.runs[0].record
    text = (
        f"Ground truth: {many.truth['file']}, {many.truth['poses']} poses. Alignment: {record['align']}. Errors are "
        f"RMSE over the matched poses of each run: read them with coverage; RPE over {record['delta']:g} "
        f"{record['unit']}; means over the runs with 95 % intervals (bootstrap, widened by Student's t), sd: standard "
        "deviation over the runs"
    )
    straight = sum(bool(run.undetermined) for run in many.runs)
    if straight:
        text += (
            f". Straight line: in {straight} of {len(many.runs)} runs the positions leave a rotation of the alignment "
            "undetermined; the smallest was taken"
        )
    if len(many.groups) < 2:
        return f"{text}."
    text += f". {BOLD} Paired tests: {many.pairs.how}{frames_of(many, tested)}"
    units = max((c.units for some in tested.values() for c in some), default=0)
    needed = least_units(len(many.groups) * (len(many.groups) - 1) // 2)
    if tested and units < needed:
        return f"{text}; significance n/a (the test needs {needed} runs that differ, here are {units})."
    return f"{text}; *: better than every other tracker at the 5 % level (Holm)." if tested else f"{text}."


def decimals_of(values: Array) -> int:
    """Decimals, 2 to 6, that show three digits of the smallest of values (n,), ignoring round-off."""
    known = values[np.isfinite(values)]
    known = known[known > ROUND_OFF * known.max(initial=0.0)]
    return int(np.clip(2 - np.floor(np.log10(known.min())), 2, 6)) if len(known) else 2


def _best(many: ManyRuns, column: Column) -> list[str]:
    """The trackers that show the lowest mean of a column of errors, ties included.

    None for one tracker, and when runs lack a value; none of a low coverage.
    """
    means = {name: column.scale * float(values.mean()) for name, values in many.values(column.key).items()}
    if len(means) < 2 or not np.isfinite(list(means.values())).all():
        return []
    shown = {name: round(mean, column.decimals) for name, mean in means.items()}
    best = [name for name in shown if shown[name] == min(shown.values())]
    covered = {name: np.mean([run.coverage for run in group]) for name, group in many.groups.items()}
    return [name for name in best if covered[name] >= KEEPS_UP * max(covered.values())]


def _stands(name: str, tested: list[Comparison], rivals: int) -> bool:
    """Whether a tracker has significantly lower values than each of its rivals, at the 5 % level."""
    own = [c for c in tested if name in (c.first, c.second)]
    return 0 < len(own) == rivals and all(c.significant and (c.difference.mean < 0) == (name == c.first) for c in own)


def _mean(values: Any, column: Column, best: bool = False, significant: bool = False) -> Cell:
    table = column.scale * np.asarray(values, dtype=np.float64)
    found = Spread.of(table)
    known = int(np.isfinite(table).sum())
    interval = column.within(found.mean) if found and len(table) > 1 else None
    return Cell(
        mean=found.mean.mean if found else None, interval=interval, known=known, runs=len(table),
        decimals=column.decimals, best=best, significant=significant,
    )  # fmt: skip


def _plain(value: float | None, decimals: int) -> Cell:
    return Cell(mean=value, interval=None, known=1, runs=1, decimals=decimals)
