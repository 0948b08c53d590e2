"""Results of `uavbench evaluate` on many runs: text, JSON, and the table of the runs."""

import textwrap
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from functools import cached_property
from typing import Any

import numpy as np

from uavbench.reports.fonts import note_on_glyphs
from uavbench.reports.json_values import json_values
from uavbench.reports.many_runs.comparison import BOLD, Spread, comparisons, extra, frames_of, summary
from uavbench.reports.many_runs.evaluate_many import METRICS, EvaluatedRun, ManyRuns
from uavbench.reports.statistics.bootstrap import Comparison
from uavbench.reports.tables.summary_table import Table
from uavbench.reports.tables.writers import heads

RUN_COLUMNS = (
    "tracker", "run", "file", "pairs", "coverage_percent", "ate_position_cm", "ate_position_median_cm",
    "ate_position_max_cm", "ate_rotation_deg", "rpe_position_cm", "rpe_rotation_deg", "nees", "nees_aligned",
    "alignment",
)  # fmt: skip


WIDTH = 110
"""Line width of prose, characters."""


class ManyResults:
    """Results of many runs; tests and table are computed once."""

    def __init__(self, many: ManyRuns) -> None:
        self.many = many

    @cached_property
    def tested(self) -> dict[str, list[Comparison]]:
        """Comparisons of every pair of trackers, by metric."""
        return comparisons(self.many)

    @cached_property
    def shared(self) -> dict[tuple[str, str], float]:
        """Share of the poses of either of two compared trackers, the lower one, that the other has, too."""
        pairs = dict.fromkeys((c.first, c.second) for found in self.tested.values() for c in found)
        return {pair: self.many.shared(pair) for pair in pairs}

    @cached_property
    def table(self) -> Table:
        """Mean and spread of each tracker."""
        return summary(self.many, self.tested)

    @cached_property
    def unshown(self) -> str:
        """A sentence about names that figures cannot show; "" without any."""
        return note_on_glyphs(dict.fromkeys(name for run in self.many.runs for name in (run.run.group, run.run.name)))

    def run_rows(self) -> list[list[Any]]:
        """A row of RUN_COLUMNS for each run; None for an undefined value."""
        return [[None if isinstance(v, float) and np.isnan(v) else v for v in _row(run)] for run in self.many.runs]

    def to_json(self) -> dict[str, Any]:
        """JSON object: ground truth, spread of each tracker, paired tests, runs; in m and deg."""
        groups = {
            name: {
                "runs": len(group), "coverage": np.mean([run.coverage for run in group]).item(),
                **{metric: _spread(self.many, metric, name) for metric in METRICS},
            }
            for name, group in self.many.groups.items()
        }  # fmt: skip
        tests = {
            metric: [
                {
                    **vars(c), "difference": json_values(vars(c.difference)), "significant": c.significant,
                    "shared": self.shared[c.first, c.second],
                }
                for c in found
            ]
            for metric, found in self.tested.items()
        }  # fmt: skip
        return {
            "truth": self.many.truth,
            "groups": groups,
            "paired": {
                "how": self.many.pairs.how,
                "frames": frames_of(self.many, self.tested).removeprefix(", "),
                "runs": self.many.pairs.n,
                "tests": tests,
            },
            "runs": [run.to_json() for run in self.many.runs],
        }

    def text(self) -> str:
        """The results as text: mean and spread, paired tests, and a line for each run."""
        return "\n".join([*self._summary_lines(), "", *self._test_lines(), *self._run_lines()]) + "\n"

    def _summary_lines(self) -> list[str]:
        heads_of_table = ["tracker", *heads(self.table)]
        rows = [
            [name, *(f"{c.text}{'*' * c.significant} {c.bounds}".strip() for c in cells)]
            for name, cells in self.table.rows
        ]
        return [
            *in_columns([heads_of_table, *rows]),
            "",
            *textwrap.wrap(self.table.caption.replace(f"{BOLD} ", ""), WIDTH),
        ]

    def _test_lines(self) -> list[str]:
        if not self.tested:
            return []
        rows = [["first - second", "metric", "mean difference", "95 %", "p (Holm)", "first wins", "poses shared"]]
        for metric, found in self.tested.items():
            about = METRICS[metric]
            for c in found:
                mean, low, high = (about.scale * v for v in (c.difference.mean, c.difference.low, c.difference.high))
                bounds = "n/a" if c.difference.why else f"[{low:.4g}, {high:.4g}]"
                names = f"{c.first} - {c.second}"
                p = f"{c.p:.3g}{'*' * c.significant}"
                shares = [f"{100 * share:.0f} %" for share in (c.wins, self.shared[c.first, c.second])]
                rows.append([names, about.name, f"{mean:.4g} {about.unit}", bounds, p, *shares])
        return [*in_columns(rows), ""]

    def _run_lines(self) -> list[str]:
        rows = [["tracker", "run", "coverage %", "ATE cm", "ATE deg", "RPE cm", "RPE deg", ""]]
        for run in self.many.runs:
            values = [f"{METRICS[metric].scale * run.value(metric):.4g}".replace("nan", "") for metric in METRICS]
            note = "straight line" if run.undetermined else ""
            rows.append([run.run.group, run.run.name, f"{100 * run.coverage:.1f}", *values, note])
        notes = dict.fromkeys(run.undetermined for run in self.many.runs if run.undetermined)
        notes |= dict.fromkeys(f"doubt: {run.run.path}: {d}" for run in self.many.runs for d in run.record["doubts"])
        return [*in_columns(rows), *(line for note in notes for line in ["", *textwrap.wrap(note, WIDTH)])]


def in_columns(rows: ListOf[ListOf[str]]) -> list[str]:
    """Rows of cells as lines with aligned columns, the first two to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [cell.ljust(w) if k < 2 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return lines


def _row(run: EvaluatedRun) -> list[Any]:
    position, rotation = run.ate["translation_m"], run.ate["rotation_deg"]
    rpe = [METRICS[metric].scale * run.value(metric) for metric in ("rpe_position", "rpe_rotation")]
    return [
        run.run.group, run.run.name, str(run.run.path), run.record["pairs"], 100 * run.coverage, 100 * position.rmse,
        100 * position.median, 100 * position.max, rotation.rmse, *rpe, extra(run, "nees"), extra(run, "nees_aligned"),
        run.undetermined or run.record["align"],
    ]  # fmt: skip


def _spread(many: ManyRuns, metric: str, name: str) -> Mapping[str, Any] | None:
    found = Spread.of(many.values(metric)[name])
    return found.to_json() if found else None
