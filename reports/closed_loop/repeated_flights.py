"""Flights without those that only repeat another seed's: see `uavbench.reports.statistics.repeats`."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict

from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.statistics.repeats import Observation, Repeats

NAMES = ("label", "run", "rate_hz", "sequence", "seed", "why", "faults")
"""Fields that are no numbers: names, and words in which names may be."""


def repeats_of(scores: Sequence[FlightScore]) -> Repeats:
    """The seeds of each sequence that repeat another one; frames are not stored, equal numbers are one flight."""
    return Repeats.of(Observation(score.run, _flight(score), score.seed, seen(score)) for score in scores)


def counted(scores: Sequence[FlightScore]) -> list[FlightScore]:
    """The scores that are observations of their own."""
    repeats = repeats_of(scores)
    return [score for score in scores if repeats.counts(_flight(score), score.seed)]


def _flight(score: FlightScore) -> str:
    return score.sequence.removesuffix(f"-s{score.seed}")


def seen(score: FlightScore) -> str:
    """Hash of all numbers of a flight."""
    text = json.dumps({name: value for name, value in asdict(score).items() if name not in NAMES})
    return hashlib.sha256(text.encode()).hexdigest()
