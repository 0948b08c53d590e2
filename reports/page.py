"""The pages of a report: an index, and one page per sequence, that open from disk without a network."""

import json
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from reports.figures_time import finite
from reports.overlay import scrubbed
from reports.pictures import View
from reports.runs import ScoredRun
from reports.style import PNG_DPI, TWO_COLUMNS_IN, colour
from reports.tables import Table
from reports.tracking import failures
from tracker.run import versions
from trajectories.files import write_text
from trajectories.pose import Array

HERE = Path(__file__).parent
TABLE_TITLES = {"details": "Details", "protocols": "With true poses on the way"}
MAX_EDGES = 150
"""The page draws this many model edges per frame at most, the longest."""


@dataclass(frozen=True)
class FigureOnPage:
    """A figure's files relative to the report's folder, with its title and caption."""

    files: tuple[str, ...]
    title: str
    caption: str
    up: str = ""

    @property
    def png(self) -> str:
        """The picture that the page shows."""
        return next(f for f in self.files if f.endswith(".png"))

    @property
    def id(self) -> str:
        """Anchor on the page."""
        return Path(self.png).stem

    def sized(self, folder: Path) -> dict[str, Any]:
        """What the template needs; width and height in CSS px."""
        with Image.open(folder / self.png) as picture:
            width, height = picture.size
        wide = width > 0.75 * TWO_COLUMNS_IN * PNG_DPI
        return {
            "files": self.files, "title": self.title, "caption": self.caption, "up": self.up, "png": self.png,
            "id": self.id, "wide": wide, "width": round(width * 96 / PNG_DPI), "height": round(height * 96 / PNG_DPI),
        }  # fmt: skip


def on_page(folder: Path, files: ListOf[Path], title: str, caption: str) -> FigureOnPage:
    """A figure with its files relative to the report."""
    return FigureOnPage(tuple(path.relative_to(folder).as_posix() for path in files), title, caption)


@dataclass(frozen=True)
class SequenceOnPage:
    """What the index and a sequence's own page show of it."""

    name: str
    page: str
    moving: str
    moving_text: str
    text: str
    index_text: str


def write_index(
    folder: Path,
    title: str,
    runs: ListOf[ScoredRun],
    tables: ListOf[tuple[str, Table]],
    figures: ListOf[FigureOnPage],
    sequences: ListOf[SequenceOnPage],
    unrendered: Mapping[str, str],
    absent: Mapping[str, str],
) -> Path:
    """Write `index.html`; unrendered and absent: sequences that could not be made and trackers not here, and why."""
    labels = list(dict.fromkeys(run.score.label for run in runs))
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    pages = {s.name: s.page for s in sequences}
    text = environment().get_template("page_index.html").render(
        title=title,
        css=asset("page.css"),
        js=asset("page.js"),
        runs=runs,
        trackers=", ".join(labels),
        rates=" and ".join(f"{rate:g} Hz" for rate in rates),
        sequences=sequences,
        unrendered=unrendered,
        absent=absent,
        summary=_shown(*tables[0], runs),
        more=[_shown(name, table, runs) for name, table in tables[1:]],
        failures=[f for run in worst_first(runs) if (f := failure(run, runs, pages)) is not None],
        figures=[f.sized(folder) for f in figures],
        record=json.dumps(runs[0].score.record, indent=1) if runs else "",
        version=versions()["uavbench"],
    )  # fmt: skip
    write_text(folder / "index.html", text)
    return folder / "index.html"


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
    """What the frame scrubber shows: model edges in px, errors, states of every run at the scrubbed frames."""
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
        "truth": [flat(view.projected(sequence.true_cam_from_world(frame))) for frame in frames],
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
        "edges": [flat(view.projected(run.latest_pose[frame])) for frame in frames],
    }


def flat(segments_px: Array) -> list[float]:
    """Segments (k, 2, 2) as a flat list with one decimal, the longest MAX_EDGES of them."""
    if len(segments_px) > MAX_EDGES:
        lengths = np.linalg.norm(segments_px[:, 1] - segments_px[:, 0], axis=1)
        segments_px = segments_px[np.sort(np.argsort(-lengths)[:MAX_EDGES])]
    return np.round(segments_px, 1).reshape(-1).tolist()


def worst_first(runs: ListOf[ScoredRun]) -> list[ScoredRun]:
    """Runs by how badly they failed: missing, crashed, then by success."""
    first = {"missing": 0, "crashed": 1}
    return sorted(runs, key=lambda run: (first.get(run.score.status, 2), run.score.tracking.success))


def failure(run: ScoredRun, runs: ListOf[ScoredRun], pages: dict[str, str]) -> dict[str, Any] | None:
    """What the page says of a run that failed; None for one that never did."""
    begins, _ = failures(run.errors.success)
    if not len(begins) and run.score.status == "complete":
        return None
    tracking = run.score.tracking
    text = f"{100 * tracking.success:.1f} % of {tracking.frames} frames within 5 cm and 5\N{DEGREE SIGN}, "
    text += f"{100 * tracking.coverage:.1f} % with a pose. "
    link = ""
    if len(begins):
        times = f"{tracking.failures} time{'s' if tracking.failures != 1 else ''}"
        first, longest = tracking.time_to_first_loss_s, tracking.longest_failure_s
        text += f"Lost {times}, first at {first:.2f} s, longest for {longest:.2f} s."
        page = pages.get(run.sequence.name)
        frame = int(run.errors.frames[begins[0]])
        place = [other for other in runs if other.sequence is run.sequence].index(run)
        link = f"{page}#run={place}&frame={frame}" if page else ""
    status = run.score.status if run.score.status != "complete" else "lost"
    return {
        "title": run.title, "sequence": run.sequence.name, "status": status, "text": text, "link": link,
        "errors": run.score.errors[:3],
    }  # fmt: skip


def _shown(name: str, table: Table, runs: ListOf[ScoredRun]) -> dict[str, Any]:
    return {
        "name": name,
        "title": TABLE_TITLES.get(name, name),
        "heads": [
            {"name": "tracker", "unit": "", "best": "min"},
            *({"name": c.head, "unit": c.unit, "best": c.best} for c in table.columns),
        ],
        "rows": [_row(run, cells, runs) for run, cells in table.rows],
        "absent": table.absent,
        "caption": table.caption,
        "files": [f"tables/{name}{suffix}" for suffix in (".md", ".csv", ".tex")],
        "shares": name == "summary",
    }


def _row(name: str, cells: Any, runs: ListOf[ScoredRun]) -> dict[str, Any]:
    group = [run for run in runs if run.name == name]
    worst = worst_first(group)[0].score
    status = worst.status if worst.status != "complete" or worst.tracking.success == 1 else "lost"
    shares = {0, 1}
    return {
        "name": name,
        "title": group[0].title,
        "colour": colour(group[0].colour),
        "status": status,
        "cells": [
            {"text": c.text + "*" * c.significant, "bounds": c.bounds, "best": c.best,
             "sort": "" if c.mean is None else f"{c.mean:.9g}",
             "share": round(c.mean, 2) if k in shares and c.mean is not None else None}
            for k, c in enumerate(cells)
        ],
    }  # fmt: skip


def environment() -> Environment:
    """The pages' templates."""
    return Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=False)


def _inlined(value: Any) -> Markup:
    """JSON that may stand in a script element."""
    return Markup(json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def asset(name: str) -> Markup:
    """A file that stands whole in a page."""
    return Markup((HERE / name).read_text(encoding="utf-8"))
