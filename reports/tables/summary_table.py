"""The summary table: means with intervals, and the best of each column marked."""

from collections.abc import Iterable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.statistics.bootstrap import Interval, compare_with, hierarchical_interval, least_units, units
from uavbench.reports.tables.columns import COLUMNS, Column
from uavbench.trajectories.errors import unknown_name
from uavbench.trajectories.pose import Array

if TYPE_CHECKING:
    from pandas import DataFrame

WON_BY_ALL = ("coverage", "within 5 cm, 5 deg", "AUC 10 cm")
OF_POSES = ("ate_", "rpe_", "model_", "bound_", "consistency_")
"""Beginnings of the keys of columns that are over the frames with a pose."""
MEAN = "_mean_"
"""Part of the keys of errors that are means over frames."""
MOST_NAMED = 3
"""Most sequences that a note names."""
KEEPS_UP = 0.9
"""Least share of the best success rate with which a tracker can be the best in errors and times: errors of a tracker
that is mostly lost are not comparable."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A mean with its interval (None for a single run), over the `known` ones of `runs` runs that have a value.

    best: no other row of the same rate shows a better value; significant: it is better than each of them at the 5 %
    level.
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
        """The interval as shown, `[low, high]`; `n/a` where it is undefined, "" for a single run."""
        if self.interval is None:
            return ""
        if self.interval.why:
            return "n/a"
        return f"[{self.interval.low:.{self.decimals}f}, {self.interval.high:.{self.decimals}f}]"

    @property
    def why(self) -> str:
        """Why the interval is undefined; "" when it is defined, and for a single run."""
        return self.interval.why if self.interval else ""


@dataclass(frozen=True)
class Table:
    """Rows of named cells under columns; absent: trackers that are not installed, without numbers.

    coverage: a sentence with the coverage of each row, for captions of errors without a column of it; of: what each row
    is of, the head of their names.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]
    absent: tuple[str, ...] = ()
    coverage: str = ""
    of: str = "tracker"

    def select(self, heads: ListOf[str]) -> "Table":
        """The table with the columns of these heads, in this order; UserError for an unknown head."""
        known = [column.head for column in self.columns]
        for head in heads:
            if head not in known:
                raise unknown_name("column", head, known)
        places = [known.index(head) for head in heads]
        rows = tuple((name, tuple(cells[k] for k in places)) for name, cells in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in places), rows=rows).with_coverage()

    def with_coverage(self) -> "Table":
        """The table with the coverage in its caption, where its columns have errors and no coverage."""
        heads, keys = [column.head for column in self.columns], [column.key for column in self.columns]
        if "coverage" in heads or not self.coverage or not any(key.startswith(OF_POSES) for key in keys):
            return self
        return replace(self, caption=f"{self.caption} {self.coverage}", coverage="")


def summary_table(frame: "DataFrame", columns: tuple[Column, ...] = COLUMNS) -> Table:
    """One row per tracker and rate, over its sequences and seeds; highest rate first, then lowest success first.

    frame: scores, as `score_frame` returns them.
    """
    groups = runs_of(frame)
    values = {run: _of_columns(rows, columns) for run, rows in groups.items()}
    cells = {
        run: [_cell(v, column) for v, column in zip(of_run, columns, strict=True)] for run, of_run in values.items()
    }
    success = {run: float(rows["tracking_success"].to_numpy().mean()) for run, rows in groups.items()}
    rates = {run: float(rows["rate_hz"].iloc[0]) for run, rows in groups.items()}
    for rate in set(rates.values()):
        rivals = [run for run in groups if rates[run] == rate]
        fit = {run for run in rivals if _keeps_up(run, rivals, success)}
        for k, column in enumerate(columns):
            if column.best:
                fit_here = set(rivals) if column.head in WON_BY_ALL else fit
                of_column = {run: values[run][k] for run in rivals}
                _mark_best({run: cells[run] for run in rivals}, of_column, k, column, fit_here)
    order = sorted(groups, key=lambda run: (-rates[run], success[run]))
    rows = tuple((run, tuple(cells[run])) for run in order)
    return Table(_caption(groups, columns, rows), columns, rows, coverage=_coverage(groups, order)).with_coverage()


def noted(table: Table, note: str) -> Table:
    """The table with a note before its caption."""
    return replace(table, caption=f"{note}. {table.caption}") if note else table


def not_rendered(names: Iterable[str]) -> str:
    """Note on sequences that could not be made, on which no tracker ran; "" for none."""
    missing = list(names)
    if not missing:
        return ""
    more = f" and {len(missing) - MOST_NAMED} more" if len(missing) > MOST_NAMED else ""
    return f"FAILED: no run on {', '.join(missing[:MOST_NAMED])}{more}, which could not be made, is counted here"


def runs_of(frame: "DataFrame") -> dict[str, "DataFrame"]:
    """Rows of a DataFrame of scores by tracker and rate, `lsd@15hz`, in their order."""
    names = [f"{label}@{rate_hz:g}hz" for label, rate_hz in zip(frame["tracker"], frame["rate_hz"], strict=True)]
    return {str(name): rows for name, rows in frame.assign(run=names).groupby("run", sort=False)}


def _caption(
    groups: Mapping[str, "DataFrame"], columns: tuple[Column, ...], rows: ListOf[tuple[str, tuple[Cell, ...]]]
) -> str:
    """Caption: failures, how the numbers are computed, intervals, and tests."""
    text = ""
    for run, group in groups.items():
        bad = group[group["status"].isin(["crashed", "missing"])]
        if len(bad):
            first = bad.iloc[0]
            why = f", first {first['sequence']}: {first['error']}" if first["error"] else ""
            text += f"FAILED: {run} {first['status']} in {len(bad)} of {len(group)} runs{why}. "
    averaged = [column.head for column in columns if MEAN in column.key]
    but = f" ({', '.join(averaged)}: means)" if averaged else ""
    text += (
        f"Errors are RMSE{but} over the frames that have a pose: read them with coverage. "
        "The time to first failure of a run without one is its duration. "
    )
    n = max(len(group) for group in groups.values())
    if n == 1:
        text += "One run each: no interval can be given. "
    else:
        text += (
            f"Means over up to {n} runs with 95 % intervals (bootstrap over sequences, then seeds, "
            "widened by Student's t). "
        )
    reasons = dict.fromkeys(cell.why for _, cells in rows for cell in cells if cell.why)
    if reasons:
        text += f"n/a: no interval ({'; '.join(reasons)}). "
    if any(0 < cell.known < cell.runs for _, cells in rows for cell in cells):
        text += "(k/n): mean over the k of n runs that have a value, left out of bold; beside it nothing has a *. "
    text += (
        "Bold: best of its column and rate; none where the best value is of a tracker with less than "
        f"{KEEPS_UP:.0%} of the best success there".replace("%", " %")
    )
    if len(groups) < 2:
        return f"{text}."
    rates = [group["rate_hz"].iloc[0] for group in groups.values()]
    rivals = max(rates.count(rate) for rate in rates) - 1
    independent = max(len(units(by_flight(group, np.zeros(len(group))))) for group in groups.values())
    needed = least_units(max(rivals, 1))
    if independent < needed:
        runs = f"{independent} independent run{'s' if independent > 1 else ''}"
        return f"{text}. Significance: n/a ({runs} at most, the test needs {needed})."
    return f"{text}; *: better than each other tracker there at the 5 % level (paired by sequence and seed, Holm)."


def _coverage(groups: Mapping[str, "DataFrame"], order: ListOf[str]) -> str:
    """Coverage of each tracker and rate, those with equal ones together, lowest first."""
    runs: dict[str, list[str]] = {}
    shares = {run: float(np.mean([v.mean() for v in by_flight(groups[run], _covered(groups[run]))])) for run in order}
    for run, share in sorted(shares.items(), key=lambda each: each[1]):
        runs.setdefault(f"{share:.1f} %", []).append(run)
    *some, (most, others) = runs.items()
    lower = "".join(f"{', '.join(names)} {share}; " for share, names in some)
    return f"Coverage: {lower}{'all others' if some and len(others) > 1 else ', '.join(others)} {most}."


def _covered(rows: "DataFrame") -> Array:
    return 100 * rows["tracking_coverage"].to_numpy(dtype=np.float64)


def by_flight(rows: "DataFrame", values: Array) -> list[Array]:
    """Values (n,) of the rows of one tracker and rate as an array over the seeds of each flight; a run counts once."""
    return [values[places] for places in _flights(rows)]


def _of_columns(rows: "DataFrame", columns: tuple[Column, ...]) -> list[list[Array]]:
    """`by_flight` of each column; the rows are sorted once."""
    flights = _flights(rows)
    return [[values[places] for places in flights] for values in (column.of(rows) for column in columns)]


def _flights(rows: "DataFrame") -> list[NDArray[np.int64]]:
    """Row indices of one tracker and rate by flight, its seeds in order; the last row of a repeated run counts."""
    runs = rows[["flight", "seed"]].reset_index(drop=True).drop_duplicates(keep="last")
    return [flight.index.to_numpy() for _, flight in runs.sort_values("seed").groupby("flight")]


def _cell(values: list[Array], column: Column) -> Cell:
    known = [k for v in values if len(k := v[np.isfinite(v)])]
    n, runs = sum(len(v) for v in known), sum(len(v) for v in values)
    if not n:
        return Cell(mean=None, interval=None, known=0, runs=runs, decimals=column.decimals)
    interval = column.within(hierarchical_interval(known))
    return Cell(
        mean=interval.mean, interval=interval if runs > 1 else None, known=n, runs=runs, decimals=column.decimals
    )  # fmt: skip


def _mark_best(
    cells: Mapping[str, list[Cell]], values: Mapping[str, list[Array]], k: int, column: Column, fit: set[str]
) -> None:
    """Mark the cells of column k that show the best value among those with a value in every run.

    None of a tracker outside `fit` is marked, and none as significant where a rival has a value in some runs only, with
    which it cannot be compared.
    """
    sign = -1.0 if column.best == "max" else 1.0
    shown = {
        run: round(sign * mean, column.decimals)
        for run, row in cells.items()
        if (mean := row[k].mean) is not None and row[k].known == row[k].runs
    }
    winners = [run for run in shown if shown[run] == min(shown.values())]
    comparable = all(run in shown or not row[k].known for run, row in cells.items())
    alone = len(winners) == 1 and len(shown) > 1 and comparable
    for run in fit.intersection(winners):
        significant = alone and _beats_all(run, {rival: values[rival] for rival in shown})
        cells[run][k] = replace(cells[run][k], best=True, significant=significant)


def _keeps_up(run: str, rivals: ListOf[str], success: Mapping[str, float]) -> bool:
    return success[run] > 0 and success[run] >= KEEPS_UP * max(success[rival] for rival in rivals)


def _beats_all(run: str, values: Mapping[str, list[Array]]) -> bool:
    """Whether a tracker differs from every other on the same runs at the 5 % level."""
    sizes = {tuple(len(v) for v in v_list) for v_list in values.values()}
    return len(sizes) == 1 and all(comparison.significant for comparison in compare_with(run, values))
