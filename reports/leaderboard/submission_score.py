"""The score of one submission to a challenge: its runs, each over all sequences, and the run that is counted."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.origin import refuse_foreign_file
from uavbench.trajectories.files.reading import read_json
from uavbench.trajectories.files.seals import is_sealed
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array

KIND = "score of a submission"
RULES = (
    "Hilti 2023 points by position error, none for a frame without a pose; mean over all sequences, of the run with "
    "the median score"
)
"""How scores are computed; scores by other rules are not comparable."""


@dataclass(frozen=True, kw_only=True)
class SequenceScore:
    """Score of one run on one sequence; flight: name of the sequence without its seed.

    points: 0 to 100; success: share of frames within 5 cm and 5 deg; coverage: share of frames with a pose; ate_*: RMSE
    over the frames with a pose, None without any.
    """

    flight: str
    frames: int
    points: float
    success: float
    coverage: float
    ate_position_m: float | None
    ate_rotation_deg: float | None


@dataclass(frozen=True, kw_only=True)
class SubmissionScore:
    """Score of a submission.

    runs: by name of the run and of the sequence, each with all sequences of the challenge; faults: of the submission.
    """

    name: str
    challenge: str
    runs: Mapping[str, Mapping[str, SequenceScore]]
    faults: tuple[str, ...] = ()
    rules: str = RULES

    def score_of(self, run: str) -> float:
        """Mean points (0 to 100) of a run over its sequences."""
        return float(np.mean([sequence.points for sequence in self.runs[run].values()]))

    @property
    def counted(self) -> str:
        """Name of the run with the median score; the lower one for an even number of runs."""
        ranked = sorted(self.runs, key=self.score_of)
        return ranked[(len(ranked) - 1) // 2]

    @property
    def score(self) -> float:
        """Score of the counted run, from 0 to 100."""
        return self.score_of(self.counted)

    def by_flight(self, key: str) -> list[Array]:
        """A field of SequenceScore of the counted run, as an array over the seeds of each flight; NaN for None."""
        flights: dict[str, list[float]] = {}
        for _, sequence in sorted(self.runs[self.counted].items()):
            value = getattr(sequence, key)
            flights.setdefault(sequence.flight, []).append(np.nan if value is None else value)
        return [np.array(values) for values in flights.values()]

    def save(self, path: Path) -> "SubmissionScore":
        """Write the score as JSON; returns the score that it replaces, or this one.

        UserError when the file is none of ours, or holds the score of another submission or by other rules.
        """
        before = self._replaced(path)
        if before.name != self.name:
            raise UserError(
                f"{path}: holds the score of {before.name!r}, not of {self.name!r}; name another file with --out"
            )
        text = json.dumps({"score": self.score, "counted": self.counted, **asdict(self)}, indent=1, allow_nan=False)
        write_text(path, text + "\n", kind=KIND)
        return before

    def _replaced(self, path: Path) -> "SubmissionScore":
        """The score in a file that this one would replace; this one if there is none. UserError as `save`."""
        refuse_foreign_file(path, KIND)
        if not path.is_file():
            return self
        try:
            return self.load(path)
        except UserError as error:
            raise UserError(f"{error}: move the file away, or name another one with --out") from None

    @classmethod
    def load(cls, path: Path) -> "SubmissionScore":
        """Read what `save` wrote; UserError when it is not a score, was edited, or was scored by other rules."""
        about = read_json(path)
        if not is_sealed(path):
            raise UserError(
                f"{path}: is not a score written by `uavbench score-submission`; score the submission again"
            )
        try:
            known = {f.name: about[f.name] for f in fields(cls)}
            score = TypeAdapter(cls).validate_python(known)
        except (KeyError, ValidationError):
            raise UserError(
                f"{path}: is not the score of a submission; give files that `score-submission` wrote"
            ) from None
        if score.rules != RULES:
            raise UserError(f"{path}: was scored by other rules ({score.rules}); score the submission again")
        return score
