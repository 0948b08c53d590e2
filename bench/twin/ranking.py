"""Ranking of trackers on a sequence and on its path-traced twin, at the same stamps."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from uavbench.bench.external.program import External, track_external
from uavbench.bench.third_party.registry import absent
from uavbench.bench.third_party.tracker import ThirdPartyTracker
from uavbench.reports.scoring.score import Score, score
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.results import Results
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.processes.guard import Guard

RANKED = 0.5
"""Share of coverage below which a tracker ranks behind all others."""


@dataclass(frozen=True)
class OnBoth:
    """Scores of a tracker on a sequence (drawn) and on its twin (traced)."""

    label: str
    drawn: Score
    traced: Score


def on_both(trackers: Mapping[str, Tracker], sequence: Sequence, twin: Sequence) -> Iterator[OnBoth]:
    """Scores of each installed tracker, from the true initial pose, at the rate of the twin.

    UserError when a tracker cannot follow a sequence at that rate.
    """
    rate_hz = float(twin.info["rate_hz"])
    missing = absent(trackers)
    for label, tracker in trackers.items():
        if label not in missing:
            first, second = (score(each, _tracked(tracker, each, rate_hz)) for each in (sequence, twin))
            yield OnBoth(label, first, second)


def table(trackers: Mapping[str, Tracker], sequence: Sequence, twin: Sequence) -> Iterator[str]:
    """Lines in Markdown: ATE RMSE (mm), coverage (%) and rank on both sequences; absent trackers with the reason."""
    found = list(on_both(trackers, sequence, twin))
    ranks = [_ranks({each.label: each.drawn for each in found}), _ranks({each.label: each.traced for each in found})]
    yield "| tracker | rasterized: ATE, mm | coverage, % | rank | traced: ATE, mm | coverage, % | rank |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    for each in found:
        cells = [
            f"{1e3 * _error_m(one):.1f} | {100 * one.tracking.coverage:.0f} | {rank[each.label]}"
            for one, rank in zip((each.drawn, each.traced), ranks, strict=True)
        ]
        yield f"| `{each.label}` | {' | '.join(cells)} |"
    for label, why in absent(trackers).items():
        yield f"| `{label}` | absent: {why} | | | | | |"
    yield f"\nThe rankings {'agree' if ranks[0] == ranks[1] else 'differ'}."


def _tracked(tracker: Tracker, sequence: Sequence, rate_hz: float) -> Results:
    if not isinstance(tracker, External | ThirdPartyTracker):
        return track_sequence(tracker, sequence, rate_hz=rate_hz, seed=0)
    program = tracker.present() if isinstance(tracker, ThirdPartyTracker) else tracker
    with Guard("uavbench-kept-") as kept:
        return track_external(program, sequence, rate_hz=rate_hz, seed=0, kept_folder=kept.folder / "job")


def _ranks(scores: Mapping[str, Score]) -> dict[str, int]:
    """Rank from 1 by ATE RMSE, trackers with a coverage below RANKED last."""
    order = sorted(scores, key=lambda label: (scores[label].tracking.coverage < RANKED, _error_m(scores[label])))
    return {label: place + 1 for place, label in enumerate(order)}


def _error_m(one: Score) -> float:
    """ATE RMSE without alignment, m; infinite where there is no pose."""
    found = one.ate["none"].translation_m
    return float("inf") if found is None else found.rmse
