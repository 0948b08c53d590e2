"""Tables and figures over the flights of a suite."""

import json
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.statistics.proportion import Proportion
from uavbench.reports.style import house_style, write_csv
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = "flights.json"
HEADS = (
    "flown", "success", "95 %", "crashed", "path rms (cm)", "added (cm)", "path max (cm)", "clearance (m)",
    "estimate rms (cm)", "filter NEES", "tracker rms (cm)", "tracker NEES", "false to crash (s)", "coverage (%)",
    "of planned (%)",
)  # fmt: skip


@in_parts(MARKER)
def write_flights(
    folder: Path, title: str, flights: ListOf[Path], failed: Mapping[str, str], *, content_hash: str = ""
) -> Path:
    """Write tables/flights.md, .csv, figures/flights/ and flights.json, which lists all scores; the latter's path."""
    from uavbench.reports.closed_loop.figure import flight_in_closed_loop

    scores = [FlightScore.load(path / "score.json") for path in flights]
    (folder / "tables").mkdir(parents=True)
    write_text(folder / "tables" / "flights.md", table(title, scores, failed))
    columns = [f.name for f in fields(FlightScore)]
    rows = [["; ".join(v) if isinstance(v, tuple) else v for v in (getattr(s, c) for c in columns)] for s in scores]
    write_csv(folder / "tables" / "flights.csv", columns, rows)
    with house_style():
        for path, score in zip(flights, scores, strict=True):
            stem = folder / "figures" / "flights" / f"{score.sequence}_{path.name}"
            stem.parent.mkdir(parents=True, exist_ok=True)
            flight_in_closed_loop(Flown.load(path), stem)
    about = {
        "title": title,
        "content_hash": content_hash,
        "scores": [asdict(s) for s in scores],
        "failed": dict(failed),
    }
    write_text(folder / MARKER, json.dumps(about, indent=1) + "\n")
    return folder / MARKER


def table(title: str, scores: ListOf[FlightScore], failed: Mapping[str, str]) -> str:
    """The measures by sequence, tracker and rate, over seeds, in Markdown."""
    groups: dict[tuple[str, str], list[FlightScore]] = {}
    for score in scores:
        groups.setdefault((score.sequence.rpartition("-s")[0], score.run), []).append(score)
    head = ["sequence", "tracker", *HEADS]
    lines = [f"# {title}", "", _row(head), "|" + " --- |" * 2 + " ---: |" * len(HEADS)]
    lines += [_row([*names, *cells(group)]) for names, group in groups.items()]
    lines += ["", "success: flown to its end without a crash and within the corridor, with its Wilson interval."]
    lines += [
        f"{score.sequence} {score.run}: {score.status} at {score.ended_s:.2f} s: {score.why}"
        for score in scores
        if score.why
    ]
    lines += [f"{name}: {why}" for name, why in failed.items()]
    return "\n".join(lines) + "\n"


def cells(group: ListOf[FlightScore]) -> list[str]:
    """Cells of a row: means over the flights of a group, the worst of clearance and greatest path error."""
    share = Proportion.of(sum(s.success for s in group), len(group))
    return [
        str(len(group)),
        f"{share.successes}",
        f"{100 * share.low:.0f}-{100 * share.high:.0f}",
        str(sum(s.status == "crashed" for s in group)),
        _mean([100 * s.path_rms_m for s in group], 1),
        _mean([100 * s.path_added_m for s in group], 1),
        f"{100 * max(s.path_max_m for s in group):.1f}",
        f"{min(s.clearance_min_m for s in group):.2f}",
        _mean([None if s.estimate_rms_m is None else 100 * s.estimate_rms_m for s in group], 1),
        _mean([s.estimate_nees for s in group], 2),
        _mean([None if s.tracker_rms_m is None else 100 * s.tracker_rms_m for s in group], 2),
        _mean([s.tracker_nees for s in group], 2),
        _mean([s.false_to_crash_s for s in group], 1),
        _mean([100 * s.coverage for s in group], 1),
        _mean([100 * s.coverage_planned for s in group], 1),
    ]


def _mean(values: ListOf[float | None], decimals: int) -> str:
    known = [value for value in values if value is not None]
    return f"{np.mean(known):.{decimals}f}" if known else ""


def _row(cells: ListOf[str]) -> str:
    return "| " + " | ".join(cells) + " |"
