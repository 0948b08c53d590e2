"""The runs that a report is about, opened for reading."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from reports.frame_errors import FrameErrors, frame_errors
from reports.score import Score
from scenes.sequence import Sequence
from tracker.results import Results
from trajectories.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """One tracker's results on one sequence, with their score."""

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
        """Name for people, `lsd, 15 Hz`."""
        return f"{self.score.label}, {self.score.rate_hz:g} Hz"

    @property
    def slug(self) -> str:
        """Name for files: sequence and run."""
        seed = f"_seed{self.score.seed}" if self.score.seed else ""
        return f"{self.sequence.name}_{self.name}{seed}".replace("/", "-").replace(" ", "-").replace(":", "-")

    @cached_property
    def errors(self) -> FrameErrors:
        """What became of every frame."""
        return frame_errors(self.sequence, self.results)

    @cached_property
    def latest_pose(self) -> list[Pose | None]:
        """Estimated cam_from_world known at each frame of the sequence: that of the latest tracked frame."""
        rows = np.searchsorted(self.results.frames, np.arange(len(self.sequence)), side="right") - 1
        return [self.results.rows[row].cam_from_world if row >= 0 else None for row in rows.tolist()]


def counts(results: Results, name: str) -> Array:
    """A count of each row (n,), NaN where a tracker gives none."""
    values = [getattr(row, name) for row in results.rows]
    return np.array([np.nan if v is None else float(v) for v in values])


def open_runs(entries: list[tuple[Path, Path, Path]]) -> list[ScoredRun]:
    """Runs of (sequence folder, results folder, score.json); a sequence is opened once, a tracker has one colour."""
    sequences: dict[Path, Sequence] = {}
    labels: dict[str, int] = {}
    runs = []
    for sequence_folder, results_folder, score_file in entries:
        sequence = sequences.setdefault(sequence_folder, Sequence.load(sequence_folder))
        found = Score.load(score_file)
        index = labels.setdefault(found.label, len(labels))
        runs.append(ScoredRun(sequence, Results.load(results_folder), found, index))
    return runs
