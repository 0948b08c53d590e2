"""The summary table: means with intervals, the best of a column marked."""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace

import numpy as np

from uavbench.reports.scoring.score import Score
from uavbench.reports.statistics.bootstrap import Interval, compare_with, hierarchical_interval, least_units, units
from uavbench.trajectories.errors import unknown_name
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the summary: its head, unit, which value is best, and how many decimals are shown.

    short: the head in LaTeX, where there is little room; the head itself where empty.
    """

    head: str
    unit: str
    best: str
    decimals: int
    short: str = ""


COLUMNS: tuple[Column, ...] = (
    Column(head="coverage", unit="%", best="max", decimals=1),
    Column(head="within 5 cm, 5 deg", unit="%", best="max", decimals=1, short="success"),
    Column(head="AUC 10 cm", unit="", best="max", decimals=2, short="AUC"),
    Column(head="ATE position", unit="cm", best="min", decimals=2, short="ATE pos."),
    Column(head="ATE rotation", unit="deg", best="min", decimals=2, short="ATE rot."),
    Column(head="RPE 1 frame", unit="cm", best="min", decimals=2, short="RPE frame"),
    Column(head="RPE 1 s", unit="cm", best="min", decimals=2),
    Column(head="edges", unit="px", best="min", decimals=1),
    Column(head="failures", unit="1/min", best="min", decimals=1),
    Column(head="first failure", unit="s", best="max", decimals=1, short="first fail."),
    Column(head="frame p50", unit="ms", best="min", decimals=1),
    Column(head="frame p95", unit="ms", best="min", decimals=1),
)
DETAILS: tuple[Column, ...] = (
    Column(head="ADD", unit="cm", best="min", decimals=2),
    Column(head="MSSD", unit="cm", best="min", decimals=2),
    Column(head="MSPD", unit="px", best="min", decimals=1),
    Column(head="recovery", unit="s", best="min", decimals=2),
    Column(head="longest failure", unit="s", best="min", decimals=2, short="longest fail."),
    Column(head="NEES", unit="6 is honest", best="", decimals=1),
    Column(head="claimed sigma", unit="cm", best="", decimals=2, short="claimed std."),
    Column(head="error / CRLB", unit="median", best="min", decimals=1, short="err./CRLB"),
    Column(head="frame p99", unit="ms", best="min", decimals=1),
    Column(head="frame max", unit="ms", best="min", decimals=1),
    Column(head="deadline misses", unit="%", best="min", decimals=1, short="misses"),
    Column(head="in real time: within 5 cm, 5 deg", unit="%", best="max", decimals=1, short="live success"),
    Column(head="in real time: frames missed", unit="%", best="min", decimals=1, short="live missed"),
    Column(head="in real time: age of the pose", unit="ms", best="min", decimals=0, short="live age"),
)
TWO_COLUMNS = ("coverage", "within 5 cm, 5 deg", "ATE position", "ATE rotation", "RPE 1 s", "failures", "frame p95")
"""The columns of a table over both columns of a page, and of the page's first table."""
ONE_COLUMN = ("within 5 cm, 5 deg", "ATE position", "ATE rotation", "frame p95")
"""The columns of a table in one column of a page."""
Numbers = Callable[[Score], tuple[float | None, ...]]
WON_BY_ALL = ("coverage", "within 5 cm, 5 deg", "AUC 10 cm")
KEEPS_UP = 0.9
"""Errors and times are won by trackers with this share of the best success: one that is lost has no good error."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A mean with its interval (None with one run only), from `known` of `runs` runs.

    best: no other row of the same rate shows a better value; significant: and it is better than each of them at the
    5 % level.
    """

    mean: float | None
    interval: Interval | None
    known: int
    runs: int
    decimals: int
    best: bool = False
    significant: bool = False

    @property
    def text(self) -> str:
        """The mean as shown, with `(k/n)` where some runs have no value."""
        if self.mean is None:
            return "\N{EM DASH}"
        missing = f" ({self.known}/{self.runs})" if self.known < self.runs else ""
        return f"{self.mean:.{self.decimals}f}{missing}"

    @property
    def bounds(self) -> str:
        """The interval as shown, `[low, high]`; `n/a` where there can be none, empty where there is one run only."""
        if self.interval is None:
            return ""
        if self.interval.why:
            return "n/a"
        return f"[{self.interval.low:.{self.decimals}f}, {self.interval.high:.{self.decimals}f}]"

    @property
    def why(self) -> str:
        """Why there is no interval, empty where there is one or none is looked for."""
        return self.interval.why if self.interval else ""


@dataclass(frozen=True)
class Table:
    """Rows of named cells under columns, with what a reader must know; absent trackers have no numbers."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    absent: tuple[str, ...] = ()

    def select(self, heads: ListOf[str]) -> "Table":
        """The table with these columns alone, in this order; UserError naming the nearest where there is none such."""
        known = [column.head for column in self.columns]
        for head in heads:
            if head not in known:
                raise unknown_name("column", head, known)
        places = [known.index(head) for head in heads]
        rows = tuple((name, tuple(cells[k] for k in places)) for name, cells in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in places), rows=rows)


def numbers(score: Score) -> tuple[float | None, ...]:
    """The numbers of a score in the order of COLUMNS; None where there is none.

    A run that never fails counts with its whole duration as its time to the first failure.
    """
    ate, tracking, total = score.ate["none"], score.tracking, score.latency.get("total")
    one_frame, one_second = score.rpe["1 frame"].translation_m, score.rpe["1 s"].translation_m
    edges = score.model.edges_px if score.model else None
    first_loss = tracking.time_to_first_loss_s
    return (
        100 * tracking.coverage,
        100 * tracking.success,
        tracking.success_auc,
        100 * ate.translation_m.rmse if ate.translation_m else None,
        ate.rotation_deg.rmse if ate.rotation_deg else None,
        100 * one_frame.rmse if one_frame else None,
        100 * one_second.rmse if one_second else None,
        edges.mean if edges else None,
        tracking.failures_per_minute,
        tracking.duration_s if first_loss is None else first_loss,
        total.p50_ms if total else None,
        total.p95_ms if total else None,
    )


def details(score: Score) -> tuple[float | None, ...]:
    """The numbers of a score in the order of DETAILS; None where there is none."""
    model, tracking, replay, total = score.model, score.tracking, score.replay, score.latency.get("total")
    claimed = score.consistency
    return (
        100 * model.add_m.mean if model and model.add_m else None,
        100 * model.mssd_m.mean if model and model.mssd_m else None,
        model.mspd_px.mean if model and model.mspd_px else None,
        tracking.time_to_recover_s,
        tracking.longest_failure_s,
        claimed.mean if claimed else None,
        100 * claimed.sharpness_m if claimed else None,
        score.bound.median if score.bound else None,
        total.p99_ms if total else None,
        total.max_ms if total else None,
        100 * score.deadline_misses if score.deadline_misses is not None else None,
        100 * replay.success if replay else None,
        100 * replay.dropped if replay else None,
        replay.age_ms if replay else None,
    )


def summary_table(scores: ListOf[Score], columns: tuple[Column, ...] = COLUMNS, numbers_of: Numbers = numbers) -> Table:
    """One row per tracker and rate, over its sequences and seeds; by rate, the worst first."""
    groups: dict[str, list[Score]] = {}
    for score in scores:
        groups.setdefault(score.run, []).append(score)
    table = {
        run: by_sequence(group, lambda score: np.array([_number(value) for value in numbers_of(score)]))
        for run, group in groups.items()
    }
    values = {run: [[v[:, k] for v in of_run] for k in range(len(columns))] for run, of_run in table.items()}
    cells = {
        run: [_cell(v, column) for v, column in zip(of_run, columns, strict=True)] for run, of_run in values.items()
    }
    success = {run: float(np.mean([score.tracking.success for score in group])) for run, group in groups.items()}
    for rate in {score.rate_hz for score in scores}:
        rivals = [run for run in groups if groups[run][0].rate_hz == rate]
        fit = {run for run in rivals if _keeps_up(run, rivals, success)}
        for k, column in enumerate(columns):
            if column.best:
                fit_here = set(rivals) if column.head in WON_BY_ALL else fit
                of_column = {run: values[run][k] for run in rivals}
                _mark_best({run: cells[run] for run in rivals}, of_column, k, column, fit_here)
    order = sorted(groups, key=lambda run: (-groups[run][0].rate_hz, success[run]))
    rows = tuple((run, tuple(cells[run])) for run in order)
    return Table(_caption(groups, rows), columns, rows)


def _caption(groups: Mapping[str, list[Score]], rows: ListOf[tuple[str, tuple[Cell, ...]]]) -> str:
    """Notes to the numbers, failures first."""
    text = ""
    for run, group in groups.items():
        bad = [score for score in group if score.status in ("crashed", "missing")]
        if bad:
            why = f", first {bad[0].sequence}: {bad[0].errors[0]}" if bad[0].errors else ""
            text += f"FAILED: {run} {bad[0].status} in {len(bad)} of {len(group)} runs{why}. "
    text += (
        "Errors are RMSE over the frames that have a pose: read them with coverage. "
        "A run that never fails has its whole duration as its first failure. "
    )
    n = max(len(group) for group in groups.values())
    if n == 1:
        text += "One run each: no interval can be given. "
    else:
        text += f"Means over up to {n} runs with 95 % intervals (bootstrap over sequences, then seeds). "
    reasons = dict.fromkeys(cell.why for _, cells in rows for cell in cells if cell.why)
    if reasons:
        text += f"n/a: no interval ({'; '.join(reasons)}). "
    text += (
        "Bold: best of its column and rate; none where the best value is of a tracker with less than "
        f"{KEEPS_UP:.0%} of the best success there".replace("%", " %")
    )
    if len(groups) < 2:
        return f"{text}."
    rivals = max(sum(g[0].rate_hz == group[0].rate_hz for g in groups.values()) for group in groups.values()) - 1
    independent = max(len(units(by_sequence(group, lambda _: np.zeros(1)))) for group in groups.values())
    needed = least_units(max(rivals, 1))
    if independent < needed:
        runs = f"{independent} independent run{'s' if independent > 1 else ''}"
        return f"{text}. Significance: n/a ({runs} at most, the test needs {needed})."
    return f"{text}; *: better than each other tracker there at the 5 % level (paired by sequence and seed, Holm)."


def by_sequence(group: ListOf[Score], value: Callable[[Score], Array | float]) -> list[Array]:
    """A value of each score per sequence, over its seeds in order; a run that is there twice counts once."""
    runs = {(score.flight, score.seed): score for score in group}
    names = sorted({flight for flight, _ in runs})
    return [np.array([value(runs[key]) for key in sorted(runs) if key[0] == name]) for name in names]


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _cell(values: list[Array], column: Column) -> Cell:
    known = [k for v in values if len(k := v[np.isfinite(v)])]
    n, runs = sum(len(v) for v in known), sum(len(v) for v in values)
    if not n:
        return Cell(mean=None, interval=None, known=0, runs=runs, decimals=column.decimals)
    interval = hierarchical_interval(known)
    return Cell(
        mean=interval.mean, interval=interval if runs > 1 else None, known=n, runs=runs, decimals=column.decimals
    )  # fmt: skip


def _mark_best(
    cells: Mapping[str, list[Cell]], values: Mapping[str, list[Array]], k: int, column: Column, fit: set[str]
) -> None:
    """Mark the best cells of column k among all that have a value in every run: those that show the best value.

    None is marked where only trackers show it that are not fit to win.
    """
    sign = -1.0 if column.best == "max" else 1.0
    shown = {
        run: round(sign * mean, column.decimals)
        for run, row in cells.items()
        if (mean := row[k].mean) is not None and row[k].known == row[k].runs
    }
    winners = [run for run in shown if shown[run] == min(shown.values())]
    if not fit.intersection(winners):
        return
    for run in winners:
        alone = len(winners) == 1 and len(shown) > 1
        significant = alone and _beats_all(run, {rival: values[rival] for rival in shown})
        cells[run][k] = replace(cells[run][k], best=True, significant=significant)


def _keeps_up(run: str, rivals: ListOf[str], success: Mapping[str, float]) -> bool:
    return success[run] > 0 and success[run] >= KEEPS_UP * max(success[rival] for rival in rivals)


def _beats_all(run: str, values: Mapping[str, list[Array]]) -> bool:
    """Whether a tracker differs from every other on the same runs, at the 5 % level."""
    sizes = {tuple(len(v) for v in v_list) for v_list in values.values()}
    return len(sizes) == 1 and all(comparison.significant for comparison in compare_with(run, values))
