"""Scored runs without those that only repeat another seed's: see `uavbench.reports.statistics.repeats`."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from uavbench.reports.scoring.score import Score
from uavbench.reports.statistics.repeats import Observation, Repeats

if TYPE_CHECKING:
    from uavbench.reports.scoring.runs import ScoredRun

TIMED = ("latency", "deadline_misses", "replay")
"""Parts of a score that differ from run to run of the same program on the same frames."""
NAMES = ("label", "rate_hz", "seed", "sequence", "errors", "record")


def repeats_of(runs: "Iterable[ScoredRun]") -> Repeats:
    """The seeds of each flight that repeat another one."""
    return Repeats.of(Observation(run.name, run.score.flight, run.score.seed, run.seen) for run in runs)


def counted(runs: "Sequence[ScoredRun]") -> "list[ScoredRun]":
    """The runs that are observations of their own."""
    repeats = repeats_of(runs)
    return [run for run in runs if repeats.counts(run.score.flight, run.score.seed)]


def seen(score: Score) -> str | None:
    """Hash of a score's frames and numbers; None where the digests of its images are unknown."""
    images = score.record.get("sequence", {}).get("images")
    numbers = {name: value for name, value in score.to_json().items() if name not in (*TIMED, *NAMES)}
    text = json.dumps([images, numbers], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest() if images else None
