"""Scores without those that only repeat another seed's: see `uavbench.reports.statistics.repeats`."""

from collections.abc import Iterable, Sequence

from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.score import Score
from uavbench.reports.scoring.seen import seen
from uavbench.reports.statistics.repeats import Observation, Repeats


def repeats_of(runs: Iterable[ScoredRun]) -> Repeats:
    """The seeds of each flight that repeat another one."""
    return Repeats.of(Observation(run.name, run.score.flight, run.score.seed, run.seen) for run in runs)


def counted(runs: Sequence[ScoredRun]) -> list[ScoredRun]:
    """The runs that are observations of their own."""
    repeats = repeats_of(runs)
    return [run for run in runs if repeats.counts(run.score.flight, run.score.seed)]


def repeats_among(scores: Iterable[Score]) -> Repeats:
    """The seeds of each flight that repeat another one, of scores without their runs."""
    return Repeats.of(Observation(each.run, each.flight, each.seed, seen(each)) for each in scores)
