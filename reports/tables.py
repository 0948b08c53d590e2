"""The summary table: means with intervals, the best of a column marked."""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass

import numpy as np

from reports.score import Score
from reports.statistics import Interval, compare_with, hierarchical_interval
from trajectories.pose import Array


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of the summary: its head, unit, which value is best, and how many decimals are shown."""

    head: str
    unit: str
    best: str
    decimals: int


COLUMNS: tuple[Column, ...] = (
    Column(head="coverage", unit="%", best="max", decimals=1),
    Column(head="within 5 cm, 5 deg", unit="%", best="max", decimals=1),
    Column(head="AUC 10 cm", unit="", best="max", decimals=2),
    Column(head="ATE position", unit="cm", best="min", decimals=2),
    Column(head="ATE rotation", unit="deg", best="min", decimals=2),
    Column(head="RPE 1 frame", unit="cm", best="min", decimals=2),
    Column(head="RPE 1 s", unit="cm", best="min", decimals=2),
    Column(head="edges", unit="px", best="min", decimals=1),
    Column(head="failures", unit="1/min", best="min", decimals=1),
    Column(head="first loss", unit="s", best="max", decimals=1),
    Column(head="frame p50", unit="ms", best="min", decimals=1),
    Column(head="frame p95", unit="ms", best="min", decimals=1),
)
DETAILS: tuple[Column, ...] = (
    Column(head="ADD", unit="cm", best="min", decimals=2),
    Column(head="MSSD", unit="cm", best="min", decimals=2),
    Column(head="MSPD", unit="px", best="min", decimals=1),
    Column(head="recovery", unit="s", best="min", decimals=2),
    Column(head="longest loss", unit="s", best="min", decimals=2),
    Column(head="NEES", unit="6 is honest", best="", decimals=1),
    Column(head="claimed sigma", unit="cm", best="", decimals=2),
    Column(head="error / CRLB", unit="median", best="min", decimals=1),
    Column(head="frame p99", unit="ms", best="min", decimals=1),
    Column(head="frame max", unit="ms", best="min", decimals=1),
    Column(head="deadline misses", unit="%", best="min", decimals=1),
    Column(head="in real time: within 5 cm, 5 deg", unit="%", best="max", decimals=1),
    Column(head="in real time: frames missed", unit="%", best="min", decimals=1),
    Column(head="in real time: age of the pose", unit="ms", best="min", decimals=0),
)
Numbers = Callable[[Score], tuple[float | None, ...]]
WON_BY_ALL = ("within 5 cm, 5 deg", "AUC 10 cm")
KEEPS_UP = 0.9
"""Errors and times are won among trackers with this share of the best success: one that is lost has no good error."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A mean with its interval (None with one run only), from `known` of `runs` runs.

    best: no other row of the same rate is better; significant: and it is better than each of them at the 5 % level.
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
        """The interval as shown, `[low, high]`; empty without one."""
        if self.interval is None:
            return ""
        return f"[{self.interval.low:.{self.decimals}f}, {self.interval.high:.{self.decimals}f}]"


@dataclass(frozen=True)
class Table:
    """Rows of named cells under columns, with what a reader must know; absent trackers have no numbers."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    absent: tuple[str, ...] = ()


def numbers(score: Score) -> tuple[float | None, ...]:
    """The numbers of a score in the order of COLUMNS; None where there is none.

    A run that never fails counts with its whole duration as its time to the first loss.
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
    cells = {
        run: [_cell(by_sequence(group, k, numbers_of), column) for k, column in enumerate(columns)]
        for run, group in groups.items()
    }
    success = {run: float(np.mean([score.tracking.success for score in group])) for run, group in groups.items()}
    for rate in {score.rate_hz for score in scores}:
        rivals = [run for run in groups if groups[run][0].rate_hz == rate]
        for k, column in enumerate(columns):
            fit = rivals if column.head in WON_BY_ALL else [run for run in rivals if _keeps_up(run, rivals, success)]
            if not column.best:
                continue
            _mark_best(
                {run: cells[run] for run in fit},
                {run: by_sequence(groups[run], k, numbers_of) for run in fit},
                k,
                column,
            )
    order = sorted(groups, key=lambda run: (-groups[run][0].rate_hz, success[run]))
    n = max(len(group) for group in groups.values())
    return Table(
        "Errors are RMSE over the frames that have a pose: read them with coverage. "
        "A run that never fails has its whole duration as its first loss. "
        + (
            f"Means over up to {n} runs with 95 % intervals (bootstrap over sequences, then seeds). "
            if n > 1
            else "One run each: no interval can be given. "
        )
        + "Bold: best at its rate, among the trackers with at least 90 % of the best success there; *: better than "
        "each of them at the 5 % level (paired, Holm).",
        columns,
        tuple((run, tuple(cells[run])) for run in order),
    )


def by_sequence(group: ListOf[Score], k: int, numbers_of: Numbers = numbers) -> list[Array]:
    """Values of column k per sequence, each over its seeds in order; NaN where there is none."""
    names = sorted({score.sequence for score in group})
    ordered = sorted(group, key=lambda score: score.seed)
    return [np.array([_number(numbers_of(score)[k]) for score in ordered if score.sequence == name]) for name in names]


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _cell(values: list[Array], column: Column) -> Cell:
    known = [k for v in values if len(k := v[np.isfinite(v)])]
    n, runs = sum(len(v) for v in known), sum(len(v) for v in values)
    if not n:
        return Cell(mean=None, interval=None, known=0, runs=runs, decimals=column.decimals)
    interval = hierarchical_interval(known)
    return Cell(
        mean=interval.mean, interval=interval if n > 1 else None, known=n, runs=runs, decimals=column.decimals
    )  # fmt: skip


def _mark_best(cells: Mapping[str, list[Cell]], values: Mapping[str, list[Array]], k: int, column: Column) -> None:
    """Mark the best cells of column k; one that misses a value in some run is not best while another has all."""
    sign = -1.0 if column.best == "max" else 1.0
    whole = {run: row[k] for run, row in cells.items() if row[k].mean is not None and row[k].known == row[k].runs}
    if not whole:
        return
    top = min(sign * (cell.mean or 0.0) for cell in whole.values())
    winners = [run for run, cell in whole.items() if sign * (cell.mean or 0.0) == top]
    for run in winners:
        cell = cells[run][k]
        significant = len(winners) == 1 and len(cells) > 1 and _beats_all(run, values, whole)
        cells[run][k] = Cell(**{**vars(cell), "best": True, "significant": significant})


def _keeps_up(run: str, rivals: ListOf[str], success: Mapping[str, float]) -> bool:
    return success[run] > 0 and success[run] >= KEEPS_UP * max(success[rival] for rival in rivals)


def _beats_all(run: str, values: Mapping[str, list[Array]], whole: Mapping[str, Cell]) -> bool:
    """Whether a tracker differs from every other that has all values on the same runs, at the 5 % level."""
    rivals = {name: values[name] for name in whole}
    sizes = {tuple(len(v) for v in v_list) for v_list in rivals.values()}
    if len(rivals) < 2 or len(sizes) > 1:
        return False
    return all(comparison.significant for comparison in compare_with(run, rivals))
