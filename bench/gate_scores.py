"""The scores of two suites' folders, paired run by run: same tracker, same rate, same frames."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from reports.score import Score
from scenes.sequence import read_json
from trajectories.errors import UserError
from trajectories.pose import Array

Key = tuple[str, str, int]
"""Tracker and rate (`lsd@15hz`), sequence without its seed, seed."""
HOW = ("compared", "association", "rpe_pairs", "success", "std_ddof")
"""Parts of a score's record that must agree before two numbers are compared."""


@dataclass(frozen=True)
class Side:
    """The scores of one folder, and what is wrong with those that are not there."""

    scores: Mapping[Key, Score]
    faults: Mapping[Key, str]


def read_side(folder: Path) -> Side:
    """Scores of a suite's folder; UserError when it is none."""
    about = read_json(folder / "suite.json")
    scores: dict[Key, Score] = {}
    faults: dict[Key, str] = {}
    try:
        names = [str(name) for name in about["sequences"]]
        runs = [f"{label}@{float(rate):g}hz" for label in about["trackers"] for rate in about["rates_hz"]]
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{folder / 'suite.json'}: not uavbench's: {error}") from None
    for name in names:
        sequence, _, seed = name.rpartition("-s")
        for run in runs:
            key = (run, sequence or name, int(seed) if sequence and seed.isdecimal() else 0)
            try:
                scores[key] = Score.load(folder / "results" / name / run / "score.json")
            except UserError as error:
                faults[key] = str(error)
    return Side(scores, faults)


def expect_comparable(base: Score, head: Score, key: Key) -> None:
    """UserError unless both scores are of the same frames and were computed the same way."""
    what = f"{key[0]} on {key[1]}, seed {key[2]}"
    if base.record.get("sequence", {}).get("content_hash") != head.record.get("sequence", {}).get("content_hash"):
        raise UserError(
            f"{what}: baseline and results are of different frames; use `uavbench compare`, or make the baseline anew"
        )
    for part in HOW:
        if base.record.get(part) != head.record.get(part):
            raise UserError(
                f"{what}: `{part}` of the scores differs ({base.record.get(part)!r}, {head.record.get(part)!r}); "
                "score both again with the same uavbench"
            )


@dataclass(frozen=True, eq=False)
class PairedValues:
    """One metric of one tracker on both sides: (sequence, seed) -> value, NaN where there is none."""

    base: Mapping[tuple[str, int], float]
    head: Mapping[tuple[str, int], float]

    def missing(self) -> str:
        """The first run without a finite number on one of the sides, and which; "" when there is none."""
        for sequence, seed in sorted({*self.base, *self.head}):
            for side, values in (("results", self.head), ("baseline", self.base)):
                if not np.isfinite(values.get((sequence, seed), np.nan)):
                    return f"no number in the {side} for {sequence}, seed {seed}"
        return ""

    @property
    def seeds(self) -> int:
        """The least number of seeds of a sequence."""
        sequences = [sequence for sequence, _ in self.head]
        return min((sequences.count(name) for name in set(sequences)), default=0)

    @property
    def sequences(self) -> list[str]:
        """Names of the sequences."""
        return sorted({sequence for sequence, _ in self.head})

    def by_sequence(self, function: Any) -> list[Array]:
        """function(base, head) of each pair, an array (seeds,) for each sequence."""
        return [
            np.array([function(self.base[key], self.head[key]) for key in sorted(self.head) if key[0] == name])
            for name in self.sequences
        ]


def read_timing(folder: Path) -> dict[str, PairedValues]:
    """Latencies of interleaved runs by tracker and rate, as `uavbench compare` writes them; none without the file."""
    path = folder / "timing.json"
    if not path.is_file():
        return {}
    try:
        runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
        return {
            run: PairedValues(
                {(row["sequence"], int(row["seed"])): float(row["base_ms"]) for row in rows},
                {(row["sequence"], int(row["seed"])): float(row["head_ms"]) for row in rows},
            )
            for run, rows in runs.items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{path}: not a timing of `uavbench compare`: {error}") from None
