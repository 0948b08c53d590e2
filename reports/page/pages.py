"""The pages of a report, an index and one page per sequence, which open from disk without a network."""

import json
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from uavbench.reports.figures.figure_files import finite
from uavbench.reports.figures.tracker_pictures import View
from uavbench.reports.page.failures import failed_trackers, status, worst_first
from uavbench.reports.page.overlay_animation import scrubbed
from uavbench.reports.page.templates import FigureOnPage, asset, environment
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.style import colour
from uavbench.reports.tables.columns import TWO_COLUMNS
from uavbench.reports.tables.summary_table import Table
from uavbench.tracker.versions import versions
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array

THEMES = {
    "Errors": ("AUC 10 cm", "RPE 1 frame", "edges", "ADD", "MSSD", "MSPD", "error / CRLB"),
    "Failures": ("failures", "first failure", "longest failure", "recovery"),
    "Claimed uncertainty": ("NEES", "claimed sigma"),
    "Time": ("frame p50", "frame p95", "frame p99", "frame max", "deadline misses"),
    "In real time": tuple(
        f"in real time: {what}" for what in ("within 5 cm, 5 deg", "frames missed", "age of the pose")
    ),
}
"""Columns of the page's detailed tables by title."""
MAX_EDGES = 150
"""Most model edges that the scrubber draws per frame, the longest ones."""


@dataclass(frozen=True)
class SequenceOnPage:
    """A sequence as shown on the index and on its own page.

    page, moving: files of the page and of the animated overlay, relative to the report; moving_text: its caption.
    """

    name: str
    page: str
    moving: str
    moving_text: str
    text: str
    index_text: str


@dataclass(frozen=True)
class Undrawn:
    """Content of a report that is drawn on request only: number of figures, and sequences without a page."""

    figures: int
    sequences: tuple[str, ...]


@dataclass(frozen=True)
class ReportNotes:
    """Title and notes of an index; unrendered: sequences, absent: trackers, each with the reason."""

    title: str
    unrendered: Mapping[str, str]
    absent: Mapping[str, str]
    undrawn: Undrawn


class NamedTable(NamedTuple):
    """A table of the folder `tables`, and the name of its files without suffix."""

    name: str
    table: Table


def write_index(
    folder: Path,
    notes: ReportNotes,
    runs: ListOf[ScoredRun],
    tables: ListOf[NamedTable],
    figures: ListOf[FigureOnPage],
    sequences: ListOf[SequenceOnPage],
) -> Path:
    """Write `index.html`: scores, failures, figures, details, and links to the sequences' pages; its path.

    tables: the summary first.
    """
    labels = list(dict.fromkeys(run.score.label for run in runs))
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    names = list(dict.fromkeys(run.sequence.name for run in runs))
    summary = tables[0].table
    text = environment().get_template("page_index.html").render(
        title=notes.title,
        css=asset("page.css"),
        js=asset("page.js"),
        runs=runs,
        trackers=", ".join(labels),
        rates=" and ".join(f"{rate:g} Hz" for rate in rates),
        names=names,
        sequences=sequences,
        unrendered=notes.unrendered,
        absent=notes.absent,
        undrawn=notes.undrawn,
        summary=_shown("summary", "Scores", summary.select(TWO_COLUMNS), runs),
        details=_themes([each.table for each in tables], runs),
        table_files=[f"tables/{t.name}{end}" for t in tables for end in TABLE_FILES[t.name == "summary"]],
        failures=failed_trackers(runs, {s.name: s.page for s in sequences}),
        figures=[f.sized(folder) for f in figures],
        record=json.dumps(runs[0].score.record, indent=1) if runs else "",
        version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)
    return folder / "index.html"


TABLE_FILES = ((".md", ".csv", ".tex"), (".md", ".csv", ".tex", "_one_column.tex"))
"""Suffixes of the files of a table, and of the summary's."""


def _themes(tables: ListOf[Table], runs: ListOf[ScoredRun]) -> list[dict[str, Any]]:
    """The detailed tables, without empty columns."""
    joined = tables[0]
    for table in tables[1:]:
        rows = zip(joined.rows, table.rows, strict=True)
        joined = replace(
            joined,
            columns=(*joined.columns, *table.columns),
            rows=tuple((name, (*a, *b)) for (name, a), (_, b) in rows),
        )
    known = {
        column.head for k, column in enumerate(joined.columns) if any(row[k].mean is not None for _, row in joined.rows)
    }
    themes = {**THEMES, **({PROTOCOLS: [c.head for c in tables[2].columns]} if len(tables) > 2 else {})}
    chosen = {title: [head for head in heads if head in known] for title, heads in themes.items()}
    joined = replace(joined, absent=())
    return [
        _shown(title.lower().replace(" ", "-"), title, joined.select(heads), runs)
        for title, heads in chosen.items()
        if heads
    ]


PROTOCOLS = "Restarts from true poses"


def write_sequence_page(
    folder: Path, title: str, shown: SequenceOnPage, runs: ListOf[ScoredRun], figures: ListOf[FigureOnPage]
) -> None:
    """Write the page of one sequence, with its frame scrubber."""
    text = environment().get_template("page_sequence.html").render(
        title=title,
        name=shown.name,
        css=asset("page.css"),
        js=asset("scrubber.js"),
        text=shown.text,
        runs=[run.title for run in runs],
        moving=shown.moving,
        moving_text=shown.moving_text,
        figures=[f.sized(folder) for f in figures],
        data=_inlined(scrubber_data(runs, shown)),
        version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / shown.page, text)


def scrubber_data(runs: ListOf[ScoredRun], shown: SequenceOnPage) -> dict[str, Any]:
    """Data of the frame scrubber: model edges in px, errors in cm and deg, and success of every run at its frames."""
    sequence = runs[0].sequence
    frames = scrubbed(len(sequence))
    blank = np.zeros((1, 1, 3), dtype=np.uint8)
    view = View(blank, sequence.camera, sequence.structure)
    seconds = (sequence.stamps_ns[frames] - sequence.stamps_ns[0]) / 1e9
    return {
        "folder": Path(shown.page).stem + "/",
        "width": sequence.camera.width,
        "height": sequence.camera.height,
        "frames": frames,
        "seconds": np.round(seconds, 4).tolist(),
        "step_ms": round(1e3 * float(np.diff(seconds).mean())) if len(frames) > 1 else 100,
        "ground_truth": [flat(view.projected(sequence.true_cam_from_world(frame))) for frame in frames],
        "runs": [_scrubbed_run(run, view, frames) for run in runs],
    }


def _scrubbed_run(run: ScoredRun, view: View, frames: list[int]) -> dict[str, Any]:
    rows = np.searchsorted(run.errors.frames, frames, side="right") - 1
    answered = np.searchsorted(run.results.frames, frames, side="right") - 1
    since = [f - int(run.results.frames[a]) if a >= 0 else None for f, a in zip(frames, answered.tolist(), strict=True)]
    return {
        "name": run.title,
        "colour": colour(run.colour),
        "cm": [finite(round(100 * v, 4)) for v in run.errors.translation_m[rows].tolist()],
        "deg": [finite(round(v, 4)) for v in run.errors.angle_deg[rows].tolist()],
        "success": run.errors.success[rows].astype(int).tolist(),
        "since": since,
        "edges": _edges(run, view, frames),
    }


def _edges(run: ScoredRun, view: View, frames: list[int]) -> list[list[float]]:
    """Projected edges at the latest estimate of each frame; a pose that holds for several frames is projected once."""
    found: list[list[float]] = []
    before: object = object()
    for frame in frames:
        pose = run.latest_pose[frame]
        found.append(found[-1] if pose is before else flat(view.projected(pose)))
        before = pose
    return found


def flat(segments_px: Array) -> list[float]:
    """The MAX_EDGES longest of segments (k, 2, 2) in px, as a flat list with one decimal."""
    if len(segments_px) > MAX_EDGES:
        lengths = np.linalg.norm(segments_px[:, 1] - segments_px[:, 0], axis=1)
        segments_px = segments_px[np.sort(np.argsort(-lengths)[:MAX_EDGES])]
    return np.round(segments_px, 1).reshape(-1).tolist()


def _shown(name: str, title: str, table: Table, runs: ListOf[ScoredRun]) -> dict[str, Any]:
    return {
        "name": name,
        "title": title,
        "heads": [
            {"name": "tracker", "unit": "", "best": "min"},
            *({"name": c.head, "unit": c.unit, "best": c.best} for c in table.columns),
        ],
        "rows": [_row(run, cells, runs) for run, cells in table.rows],
        "absent": table.absent,
        "caption": table.caption if name == "summary" else "",
        "shares": name == "summary",
    }


def _row(name: str, cells: Any, runs: ListOf[ScoredRun]) -> dict[str, Any]:
    group = [run for run in runs if run.name == name]
    shares = {0, 1}
    return {
        "name": name,
        "title": group[0].title,
        "colour": colour(group[0].colour),
        "status": status(worst_first(group)[0]),
        "cells": [
            {"text": c.text + "*" * c.significant, "bounds": c.bounds, "why": c.why, "best": c.best,
             "sort": "" if c.mean is None else f"{c.mean:.9g}",
             "share": round(c.mean, 2) if k in shares and c.mean is not None else None}
            for k, c in enumerate(cells)
        ],
    }  # fmt: skip


def _inlined(value: Any) -> Markup:
    """JSON that is safe in a script element."""
    return Markup(json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
