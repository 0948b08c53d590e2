"""Report of runs that are restarted from true poses: how often and how soon they fail.

Conventions: with resets, a frame beyond 5 cm or 5 deg, or without a pose, is a failure and the next starts from the
ground truth; with anchors, every run starts from the ground truth every 5 s, whatever happened before.
"""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from uavbench.reports.figures.drawn import Drawn, save_drawn
from uavbench.reports.metrics.frame_errors import frame_errors
from uavbench.reports.protocols.restarting import Restarted, accuracy, expected_error
from uavbench.reports.scoring.score import Score
from uavbench.reports.style import GROUND_TRUTH, line, marker, panel_letter
from uavbench.reports.tables.summary_table import Column, Numbers
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError

COLUMNS: tuple[Column, ...] = (
    Column(head="failures, with resets", unit="1/min", best="min", decimals=1),
    Column(head="ATE between resets", unit="cm", best="min", decimals=2),
    Column(head="median error after an anchor", unit="cm", best="min", decimals=2),
    Column(head="failed after an anchor", unit="%", best="min", decimals=1),
)


@dataclass(frozen=True, eq=False)
class RestartedRun:
    """One tracker on one sequence under such a protocol."""

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
        """Rate at which it tracked."""
        return float(self.restarted.results.record["rate_hz"])

    @property
    def key(self) -> tuple[str, str, int]:
        """The key that it shares with the score of the free run."""
        return self.name, self.sequence.name, int(self.restarted.results.record["seed"])


def open_restarts(folders: ListOf[Path], sequences: ListOf[Sequence]) -> list[RestartedRun]:
    """Runs of these folders on these sequences; UserError where they do not belong together."""
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


def numbers_of(runs: ListOf[RestartedRun]) -> Numbers:
    """The numbers of COLUMNS for the score of each free run; None where a protocol was not run."""
    resets = {run.key: run for run in runs if run.protocol == "reset"}
    anchored = {run.key: run for run in runs if run.protocol == "anchors"}

    def numbers(score: Score) -> tuple[float | None, ...]:
        key = (score.run, score.sequence, score.seed)
        reset, anchor = resets.get(key), anchored.get(key)
        between = accuracy(reset.restarted, reset.sequence) if reset else None
        after = frame_errors(anchor.sequence, anchor.restarted.results).translation_m if anchor else np.array([np.inf])
        median = float(np.median(after))
        return (
            reset.restarted.failures_per_minute if reset else None,
            100 * between.rmse if between else None,
            100 * median if np.isfinite(median) else None,
            100 * float(anchor.restarted.failed.mean()) if anchor else None,
        )

    return numbers


def error_after_anchors(runs: ListOf[RestartedRun], colours: Mapping[str, int], stem: Path) -> list[Path]:
    """Write `draw_error_after_anchors` as files at a stem."""
    return save_drawn(partial(draw_error_after_anchors, runs, colours), stem, 2.0)


def draw_error_after_anchors(runs: ListOf[RestartedRun], colours: Mapping[str, int], figure: Figure) -> Drawn:
    """Median error and share of failed frames against the time since the last true pose, over all sequences."""
    anchored = [run for run in runs if run.protocol == "anchors"]
    error, failed = figure.subplots(1, 2)
    rows: list[list[object]] = []
    fastest_hz = max(run.rate_hz for run in anchored)
    for name, rate_hz in {run.name: run.rate_hz for run in anchored}.items():
        group = [(run.restarted, run.sequence) for run in anchored if run.name == name]
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
    figure.legend(*error.get_legend_handles_labels(), loc="outside upper center", ncols=6)
    return Drawn(columns=["run", "since_s", "median_error_m", "share_failed"], rows=rows, legend=None)
