"""Report of runs that are restarted from true poses: how often and how soon they fail.

Conventions: with resets, a frame beyond 5 cm or 5 deg, or without a pose, is a failure and the next starts from the
ground truth; with anchors, every run restarts from the ground truth every 5 s, regardless of failures.
"""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from uavbench.reports.figures.figure_files import Drawn, legend_of, save_drawn
from uavbench.reports.metrics.frame_errors import frame_errors
from uavbench.reports.protocols.restarting import Restarted, RestartedOn, accuracy, expected_error
from uavbench.reports.style import GROUND_TRUTH, line, marker, panel_letter
from uavbench.reports.tables.columns import Column
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError

if TYPE_CHECKING:
    from pandas import DataFrame

COLUMNS: tuple[Column, ...] = (
    Column(head="failures, with resets", key="reset_failures_per_minute", unit="1/min", best="min", decimals=1),
    Column(head="ATE between resets", key="reset_ate_rmse_m", scale=100, unit="cm", best="min", decimals=2),
    Column(
        head="median error after an anchor", key="anchors_error_median_m", scale=100, unit="cm", best="min", decimals=2
    ),
    Column(head="failed after an anchor", key="anchors_failed", scale=100, unit="%", best="min", decimals=1),
)


@dataclass(frozen=True, eq=False)
class RestartedRun:
    """One tracker on one sequence under a protocol with restarts."""

    sequence: Sequence
    restarted: Restarted

    @property
    def protocol(self) -> str:
        """`reset` or `anchors`."""
        return str(self.restarted.results.record["protocol"])

    @property
    def name(self) -> str:
        """Name of tracker and rate, `lsd@15hz`."""
        record = self.restarted.results.record
        return f"{record['label']}@{record['rate_hz']:g}hz"

    @property
    def rate_hz(self) -> float:
        """Rate of the run in Hz."""
        return float(self.restarted.results.record["rate_hz"])

    def numbers(self) -> dict[str, float | None]:
        """Measures of the protocol by the keys of COLUMNS, which extend the score of the run without restarts."""
        if self.protocol == "reset":
            between = accuracy(self.restarted, self.sequence)
            return {
                "reset_failures_per_minute": self.restarted.failures_per_minute,
                "reset_ate_rmse_m": between.rmse if between else None,
            }
        median = float(np.median(frame_errors(self.sequence, self.restarted.results).translation_m))
        return {
            "anchors_error_median_m": median if np.isfinite(median) else None,
            "anchors_failed": float(self.restarted.failed.mean()),
        }


def open_restarts(folders: ListOf[Path], sequences: ListOf[Sequence]) -> list[RestartedRun]:
    """Restarted runs from folders of results; UserError for results of another version of a sequence."""
    by_name = {sequence.name: sequence for sequence in sequences}
    runs = []
    for folder in folders:
        restarted = Restarted.load(folder)
        about = restarted.results.record["sequence"]
        sequence = by_name.get(about["name"])
        if sequence is None or sequence.content_hash != about["content_hash"]:
            raise UserError(f"{folder}: is of another version of sequence {about['name']}; track again")
        runs.append(RestartedRun(sequence, restarted))
    return runs


def with_restarts(frame: "DataFrame", runs: ListOf[RestartedRun]) -> "DataFrame":
    """DataFrame of the free runs' scores with the numbers of COLUMNS appended, NaN where a protocol was not run."""
    from pandas import DataFrame

    of_run: dict[tuple[str, float, str, int], dict[str, float | None]] = {}
    for run in runs:
        record = run.restarted.results.record
        key = (str(record["label"]), run.rate_hz, run.sequence.name, int(record["seed"]))
        of_run[key] = of_run.get(key, {}) | run.numbers()
    keys = zip(*(frame[name] for name in ("tracker", "rate_hz", "sequence", "seed")), strict=True)
    added = DataFrame([of_run.get(key, {}) for key in keys], index=frame.index, columns=[c.key for c in COLUMNS])
    return frame.join(added)


def error_after_anchors(runs: ListOf[RestartedRun], colours: Mapping[str, int], stem: Path) -> list[Path]:
    """Write `draw_error_after_anchors` as files at a stem; their paths."""
    return save_drawn(partial(draw_error_after_anchors, runs, colours), stem, 2.0)


def draw_error_after_anchors(runs: ListOf[RestartedRun], colours: Mapping[str, int], figure: Figure) -> Drawn:
    """Median error and share of failed frames against the time since the last true pose, over all sequences."""
    anchored = [run for run in runs if run.protocol == "anchors"]
    error, failed = figure.subplots(1, 2)
    rows: list[list[object]] = []
    fastest_hz = max(run.rate_hz for run in anchored)
    for name, rate_hz in {run.name: run.rate_hz for run in anchored}.items():
        group = [RestartedOn(run.restarted, run.sequence) for run in anchored if run.name == name]
        slower = rate_hz < fastest_hz
        style = line(colours.get(name, 0), slower=slower)
        if slower:
            style |= {"marker": marker(colours.get(name, 0))["marker"], "ms": 2.5, "mfc": "white"}
        since_s, median_m, share = expected_error(group)
        shown = np.where(np.isfinite(median_m), 100 * median_m, np.nan)
        error.plot(since_s, shown, label=name, **style)
        failed.plot(since_s, 100 * share, **style)
        known = [None if np.isnan(cm) else cm / 100 for cm in shown.tolist()]
        rows += [[name, *row] for row in zip(since_s.tolist(), known, share.tolist(), strict=True)]
    error.set_ylabel("median error (cm)")
    error.axhline(5, color=GROUND_TRUTH, lw=0.6, ls=":")
    error.set_ylim(bottom=0)
    failed.set_ylabel("frames failed (%)")
    failed.set_ylim(-3, 103)
    for letter, panel in zip("ab", (error, failed), strict=True):
        panel.set_xlabel("time since the last true pose (s)")
        panel_letter(panel, letter)
    columns = ["run", "since_s", "median_error_m", "share_failed"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(error, {"ncols": 6}))
