"""The runs of a report: sequences, results and scores read from their files."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uavbench.reports.metrics.frame_errors import FrameErrors, frame_errors
from uavbench.reports.scoring.score import Score, how, score
from uavbench.reports.scoring.seen import seen
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results, cam_from_evaluated
from uavbench.tracker.sound_results import sound
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """One tracker's results on one sequence, with their score; colour: index of the tracker's colour."""

    sequence: Sequence
    results: Results
    score: Score
    colour: int

    @property
    def name(self) -> str:
        """Name of tracker and rate, `lsd@15hz`."""
        return self.score.run

    @property
    def title(self) -> str:
        """Name in figures and pages, `lsd, 15 Hz`."""
        return f"{self.score.label}, {self.score.rate_hz:g} Hz"

    @property
    def slug(self) -> str:
        """Sequence, run and seed as a file name."""
        seed = f"_seed{self.score.seed}" if self.score.seed else ""
        return f"{self.sequence.name}_{self.name}{seed}".replace("/", "-").replace(" ", "-").replace(":", "-")

    @cached_property
    def errors(self) -> FrameErrors:
        """Pose error of every expected frame, infinite where it is lost."""
        return frame_errors(self.sequence, self.results)

    @cached_property
    def seen(self) -> str | None:
        """Hash of its frames and numbers, by which runs that repeat another one are found; None where unknown."""
        return seen(self.score)

    def frames(self) -> "DataFrame":
        """One row per expected frame; position and rotation error are NaN without a pose.

        Columns: frame (in the sequence), stamp_ns, time_s since the first, position_error_m, rotation_error_deg, and
        success: within 5 cm and 5 deg.
        """
        from pandas import DataFrame

        errors = self.errors
        columns = {
            "frame": errors.frames,
            "stamp_ns": errors.pairs.stamps_ns,
            "time_s": errors.seconds,
            "position_error_m": np.where(errors.ok, errors.translation_m, np.nan),
            "rotation_error_deg": np.where(errors.ok, errors.angle_deg, np.nan),
            "success": errors.success,
        }
        return DataFrame(columns)

    @cached_property
    def latest_pose(self) -> list[Pose | None]:
        """Latest estimated cam_from_world at each frame of the sequence; None before the first and where it is lost."""
        rows = np.searchsorted(self.results.frames, np.arange(len(self.sequence)), side="right") - 1
        return [self.results.rows[row].cam_from_world if row >= 0 else None for row in rows.tolist()]


def counts(results: Results, name: str) -> Array:
    """A count (n,) of each row, such as `inliers`; NaN where the tracker gives none."""
    values = [getattr(row, name) for row in results.rows]
    return np.array([np.nan if v is None else float(v) for v in values])


@dataclass(frozen=True)
class ReportEntry:
    """One scored run: folders of sequence and results, and its score.json; why: reason for missing results, or ""."""

    sequence: Path
    results: Path
    score: Path
    why: str = ""


def open_runs(entries: ListOf[ReportEntry]) -> list[ScoredRun]:
    """Runs of a report's entries; each sequence is loaded once, each tracker has one colour.

    A run with a missing results folder, or with a reason in `why`, is scored as one without any pose. UserError naming
    a file that is missing or invalid, or a score that was not computed from these results.
    """
    sequences: dict[Path, Sequence] = {}
    labels: dict[str, int] = {}
    runs = []
    for entry in entries:
        if entry.sequence not in sequences:
            sequences[entry.sequence] = Sequence.load(entry.sequence)
        sequence = sequences[entry.sequence]
        if entry.results.exists() and not entry.why:
            results, found = sound(Results.load(entry.results))[0], Score.load(entry.score)
            _belongs(found, sequence, results, entry.score)
        else:
            results = missing_results(sequence, entry.results, entry.why)
            found = score(sequence, results)
        index = labels.setdefault(found.label, len(labels))
        runs.append(ScoredRun(sequence, results, found, index))
    return runs


def _belongs(found: Score, sequence: Sequence, results: Results, path: Path) -> None:
    """UserError unless a score is of these results and this sequence, computed in the current way."""
    for key, now in how(sequence, results).items():
        if key == "versions":
            continue
        before = found.record.get(key)
        if before != now:
            raise UserError(f"{path}: its record has {key} = {before!r}, not {now!r} as here; score again")


def missing_results(sequence: Sequence, folder: Path, why: str = "") -> Results:
    """Results without rows for a missing run; UserError unless its folder is named `LABEL@RATEhz`."""
    label, _, rate = folder.name.partition("@")
    try:
        rate_hz = float(rate.removesuffix("hz"))
    except ValueError:
        raise UserError(
            f"{folder}: no such results, and its name does not give tracker and rate (LABEL@RATEhz)"
        ) from None
    record = {
        "tracker": {"kind": label, "parameters": {}},
        "label": label,
        "rate_hz": rate_hz,
        "seed": int(sequence.info.get("seed", 0)),
        "sequence": {"name": sequence.name, "content_hash": sequence.content_hash},
        "cam_from_body": cam_from_evaluated(sequence).matrix.tolist(),
        "errors": [why] if why else [],
    }
    return Results(record, np.empty(0, np.int64), np.empty(0, np.int64), ())
