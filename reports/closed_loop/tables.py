"""Tables over the flights of a suite, in Markdown: measures by sequence and run, and every two runs."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass

import numpy as np

from uavbench.reports.closed_loop.comparison import PairOfRuns, flown_of, success
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.closed_loop.repeated_flights import counted, repeats_of
from uavbench.reports.statistics.bootstrap import CONFIDENCE

HEADS = (
    "flown", "success", "95 %", "crashed", "path rms (cm)", "added (cm)", "path max (cm)", "clearance (m)",
    "estimate rms (cm)", "filter NEES", "tracker rms (cm)", "tracker NEES", "false to crash (s)", "coverage (%)",
    "of planned (%)",
)  # fmt: skip
PAIR_HEADS = (
    "flights", "only the first succeeds", "only the second", "p", "both succeed", "path rms, first - second (cm)",
    "95 %", "p",
)  # fmt: skip
PAIRS_TOLD = (
    "Runs on the same sequences and seeds; p of success by McNemar's exact test, of the path error by the paired "
    "bootstrap over flights in which both succeed, or Student's t where it is larger, each adjusted by Holm over all "
    "pairs; * at the 5 % level."
)
MEASURES_TOLD = (
    "Success: flown to its end without a crash and within the corridor, with its Wilson interval; a flight that could "
    "not be flown counts as none, and is in no mean."
)
ALPHA = 1 - CONFIDENCE
"""Significance level."""
FAULTS_TOLD = 3
"""Most faults of one flight that are listed."""
MOST_DIGITS = 1e6
"""Numbers from here on are written with an exponent."""


@dataclass(frozen=True)
class FlightNotes:
    """Title and notes of a report.

    failed: flights that could not be flown, as `SEQUENCE RUN`, and why; absent: trackers that are not installed, and
    why; videos: files of flights' videos, relative to the report.
    """

    title: str
    failed: Mapping[str, str]
    absent: Mapping[str, str]
    videos: tuple[str, ...] = ()

    def every(self, scores: ListOf[FlightScore]) -> list[FlightScore]:
        """The flights of these scores, and as no success those that could not be flown."""
        names = ((name.partition(" "), why) for name, why in self.failed.items())
        return [*scores, *(FlightScore.not_flown(sequence, run, why) for (sequence, _, run), why in names)]

    def judged(self, scores: ListOf[FlightScore]) -> list[FlightScore]:
        """Of every flight those that are observations of their own."""
        return counted(self.every(scores))


def why_failed(score: FlightScore) -> str:
    """Why a flight is no success."""
    return score.why or f"it left its corridor: it was up to {score.path_max_m:.2f} m from its path"


def faults_of(score: FlightScore) -> list[str]:
    """The first FAULTS_TOLD faults of a flight's tracker, with their times, and the number of the others."""
    more = len(score.faults) - FAULTS_TOLD
    others = [f"and {more} more fault{'s' if more > 1 else ''} of its tracker"] if more > 0 else []
    return [*score.faults[:FAULTS_TOLD], *others]


def groups_of(scores: ListOf[FlightScore]) -> dict[tuple[str, str], list[FlightScore]]:
    """Scores by sequence without its seed, and run."""
    groups: dict[tuple[str, str], list[FlightScore]] = {}
    for score in scores:
        groups.setdefault((score.sequence.rpartition("-s")[0], score.run), []).append(score)
    return groups


def table(notes: FlightNotes, scores: ListOf[FlightScore]) -> str:
    """Markdown table of the measures by sequence, tracker, rate and loop, over seeds."""
    lines = [f"# {notes.title}", "", *_head(["sequence", "tracker"], HEADS)]
    lines += [_row([*names, *cells(group)]) for names, group in groups_of(notes.judged(scores)).items()]
    lines += ["", *told(notes.every(scores))]
    lines += [
        f"{s.sequence} {s.run}: {s.status} at {s.ended_s:.2f} s: {why_failed(s)}" for s in scores if not s.success
    ]
    lines += [f"{s.sequence} {s.run}: {fault}" for s in scores for fault in faults_of(s)]
    lines += [f"{name}: {why}" for name, why in {**notes.failed, **notes.absent}.items()]
    return "\n".join(lines) + "\n"


def told(scores: ListOf[FlightScore]) -> list[str]:
    """How success is measured, and which seeds count once."""
    repeats = str(repeats_of(scores))
    return [MEASURES_TOLD, *([f"{repeats}."] if repeats else [])]


def table_of_pairs(title: str, pairs: ListOf[PairOfRuns]) -> str:
    """Markdown table of every pair of runs."""
    lines = [f"# {title}", "", *_head(["first", "second"], PAIR_HEADS)]
    lines += [_row([pair.first, pair.second, *cells_of_pair(pair)]) for pair in pairs]
    return "\n".join([*lines, "", PAIRS_TOLD]) + "\n"


def cells(group: ListOf[FlightScore]) -> list[str]:
    """Cells of HEADS: means over the flown flights of a group; least clearance and greatest path error."""
    share, every = success(group), len(group)
    group = flown_of(group)
    return [
        str(every) if len(group) == every else f"{len(group)} of {every}",
        f"{share.successes}",
        f"{100 * share.low:.0f}-{100 * share.high:.0f}",
        str(sum(s.status == "crashed" for s in group)),
        _mean([100 * s.path_rms_m for s in group], 1),
        _mean([100 * s.path_added_m for s in group], 1),
        f"{100 * max(s.path_max_m for s in group):.1f}" if group else "",
        f"{min(s.clearance_min_m for s in group):.2f}" if group else "",
        _mean([None if s.estimate_rms_m is None else 100 * s.estimate_rms_m for s in group], 1),
        _mean([s.estimate_nees for s in group], 2),
        _mean([None if s.tracker_rms_m is None else 100 * s.tracker_rms_m for s in group], 2),
        _mean([s.tracker_nees for s in group], 2),
        _mean([s.false_to_crash_s for s in group], 1),
        _mean([100 * s.coverage for s in group], 1),
        _mean([100 * s.coverage_planned for s in group], 1),
    ]


def cells_of_pair(pair: PairOfRuns) -> list[str]:
    """Cells of PAIR_HEADS."""
    path, bounds = "", ""
    if pair.path_m is not None:
        path = f"{100 * pair.path_m.mean:+.2f}"
        bounds = pair.path_m.why or f"{100 * pair.path_m.low:+.2f} to {100 * pair.path_m.high:+.2f}"
    return [
        str(pair.flights),
        str(pair.first_only),
        str(pair.second_only),
        f"{pair.success_p:.3g}{'*' * (pair.success_p <= ALPHA)}",
        str(pair.both),
        path,
        bounds,
        f"{pair.path_p:.3g}{'*' * (pair.path_p <= ALPHA)}" if pair.path_m is not None else "",
    ]


def _mean(values: ListOf[float | None], decimals: int) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return ""
    mean = float(np.mean(known))
    return f"{mean:.{decimals}f}" if abs(mean) < MOST_DIGITS else f"{mean:.0e}"


def _head(names: ListOf[str], heads: ListOf[str]) -> list[str]:
    return [_row([*names, *heads]), "|" + " --- |" * len(names) + " ---: |" * len(heads)]


def _row(cells: ListOf[str]) -> str:
    return "| " + " | ".join(cells) + " |"
