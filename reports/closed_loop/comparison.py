"""Comparison of closed-loop runs by tracker, rate and loop: success rates, and paired tests.

Conventions: runs are compared in pairs on the same sequences and seeds: success by McNemar's exact test on the flights
in which only one of the two succeeds, the path error by `uavbench.reports.statistics` (the larger p of the paired
bootstrap and of Student's t) over the flights in which both succeed. p is adjusted by Holm over all pairs of a table.
"""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binomtest

from uavbench.reports.closed_loop.measures import NOT_FLOWN, FlightScore
from uavbench.reports.statistics.bootstrap import Interval, compare, holm
from uavbench.reports.statistics.proportion import Proportion
from uavbench.trajectories.pose import Array


def by_run(scores: ListOf[FlightScore]) -> dict[str, list[FlightScore]]:
    """Scores by run (tracker, rate and loop), in their order."""
    groups: dict[str, list[FlightScore]] = {}
    for score in scores:
        groups.setdefault(score.run, []).append(score)
    return groups


def flown_of(group: ListOf[FlightScore]) -> list[FlightScore]:
    """The flights of a group that have numbers."""
    return [score for score in group if score.status != NOT_FLOWN]


def success(group: ListOf[FlightScore]) -> Proportion:
    """Success rate of a group of flights, with its Wilson interval."""
    return Proportion.of(sum(score.success for score in group), len(group))


@dataclass(frozen=True, kw_only=True)
class PairOfRuns:
    """Comparison of two runs on their common flights.

    first_only, second_only: number of flights in which only that run succeeds; success_p: of McNemar's test on them.
    path_m: rms path error of the first minus that of the second in m, over the `both` flights in which both succeed;
    None, with path_p 1, without any.
    """

    first: str
    second: str
    flights: int
    first_only: int
    second_only: int
    both: int
    success_p: float
    path_m: Interval | None
    path_p: float


def compared(scores: ListOf[FlightScore]) -> list[PairOfRuns]:
    """Every pair of runs with common flights, p adjusted by Holm."""
    groups = {run: {(s.sequence, s.seed): s for s in group} for run, group in by_run(scores).items()}
    names = list(groups)
    pairs = [
        _pair(
            first, second, [(groups[first][key], groups[second][key]) for key in groups[first] if key in groups[second]]
        )
        for k, first in enumerate(names)
        for second in names[k + 1 :]
        if groups[first].keys() & groups[second].keys()
    ]
    of_success, of_path = holm([pair.success_p for pair in pairs]), holm([pair.path_p for pair in pairs])
    return [replace(pair, success_p=s, path_p=p) for pair, s, p in zip(pairs, of_success, of_path, strict=True)]


def _pair(first: str, second: str, flights: ListOf[tuple[FlightScore, FlightScore]]) -> PairOfRuns:
    alone = [sum(a.success and not b.success for a, b in flights), sum(b.success and not a.success for a, b in flights)]
    both = [(a, b) for a, b in flights if a.success and b.success]
    path_m, path_p = None, 1.0
    if both:
        values = {name: _by_sequence([pair[side] for pair in both]) for side, name in enumerate((first, second))}
        found = compare(first, second, values)
        path_m, path_p = found.difference, found.p
    return PairOfRuns(
        first=first,
        second=second,
        flights=len(flights),
        first_only=alone[0],
        second_only=alone[1],
        both=len(both),
        success_p=float(binomtest(alone[0], sum(alone)).pvalue) if sum(alone) else 1.0,
        path_m=path_m,
        path_p=path_p,
    )


def _by_sequence(group: ListOf[FlightScore]) -> list[Array]:
    """Rms path errors in m, an array over the seeds of each sequence."""
    names = dict.fromkeys(score.sequence.rpartition("-s")[0] for score in group)
    return [np.array([s.path_rms_m for s in group if s.sequence.rpartition("-s")[0] == name]) for name in names]
