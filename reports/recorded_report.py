"""The report over runs on recorded sequences: coverage, times and overlays; no errors without ground truth.

index.html                   the summary, and for each sequence figures and overlays
figures/*.pdf *.png *.csv    figures and the numbers behind them
figures/overlay_*.webp       the model at each tracker's estimate on the images, moving
tables/summary.*             Markdown, CSV, LaTeX
scores.json, report.json     all scores; the content hash of the report
"""

import json
from collections.abc import Callable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image as Pillow

from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn, save_panel
from uavbench.reports.figures.tracker_pictures import GREEN, View, draw, write_text_on
from uavbench.reports.page.overlay_animation import ANIMATION_WIDTH_PX, WEBP_QUALITY, scrubbed
from uavbench.reports.page.templates import FigureOnPage, asset, environment, on_page
from uavbench.reports.recorded_score import MEETS_PX, RecordedRun, RecordedScore, score_recorded
from uavbench.reports.scoring.runs import ReportEntry, missing_results
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.style import colour, house_style, line
from uavbench.reports.tables.columns import Column
from uavbench.reports.tables.summary_table import Cell, Table, not_rendered, noted, runs_of
from uavbench.reports.tables.writers import heads, write_tables
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results
from uavbench.tracker.sound_results import sound
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, new_file, write_text

COLUMNS: tuple[Column, ...] = (
    Column(head="coverage", key="coverage", scale=100, unit="%", best="max", decimals=1),
    Column(head="longest gap", key="longest_gap_s", unit="s", best="min", decimals=2),
    Column(head="edges met", key="edges_met", scale=100, unit="%", best="", decimals=1),
    Column(head="frame p50", key="latency_total_p50_ms", unit="ms", best="min", decimals=1),
    Column(head="frame p95", key="latency_total_p95_ms", unit="ms", best="min", decimals=1),
    Column(head="deadline misses", key="deadline_misses", scale=100, unit="%", best="min", decimals=1),
)
MARKER = Marker("report.json", "report of recordings")
CAPTION = (
    "Real images without ground truth: no error is known. Coverage is the share of frames with a pose, right or wrong; "
    "edges "
    f"met the share of the model's visible edges within {MEETS_PX:g} px of an image's edge, over frames with a pose."
)
MOST_OVERLAY_FRAMES = 150


@dataclass(frozen=True, eq=False)
class Shown:
    """A scored run with its colour."""

    run: RecordedRun
    score: RecordedScore
    colour: int

    @property
    def title(self) -> str:
        """Name in figures and pages, `lsd, 30 Hz`."""
        return f"{self.score.label}, {self.score.rate_hz:g} Hz"

    @property
    def slug(self) -> str:
        """Sequence and run as a file name."""
        return f"{self.score.sequence}_{self.score.run}".replace("/", "-").replace(" ", "-").replace(":", "-")


@in_parts(MARKER)
def write_recorded_report(
    folder: Path,
    title: str,
    entries: ListOf[ReportEntry],
    *,
    absent: Mapping[str, str],
    unrendered: Mapping[str, str] = {},
    content_hash: str = "",
    on_step: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the report over runs on recordings; the path of its index.html.

    absent: trackers that are not installed, and why; unrendered: recordings that could not be imported, and why.
    UserError when there is no entry.
    """
    if not entries:
        raise UserError("a report needs at least one scored run")
    runs = open_recorded(entries)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    names = list(dict.fromkeys(shown.score.sequence for shown in runs))
    table = noted(summary(runs, tuple(absent)), not_rendered(unrendered))
    write_tables(table, folder / "tables" / "summary")
    sections = []
    with house_style():
        for done, name in enumerate(names):
            some = [shown for shown in runs if shown.score.sequence == name]
            sections.append({"name": name, **section(folder, some)})
            if on_step is not None:
                on_step(done + 1, len(names))
    text = environment().get_template("page_recorded.html").render(
        title=title, css=asset("page.css"), table=table, heads=heads(table), runs=runs, absent=absent,
        unrendered=unrendered, sections=sections, status={s.score.run: s.score.status for s in runs}, colour=colour,
        version=versions()["uavbench"], record=json.dumps(runs[0].score.record, indent=1),
    )  # fmt: skip
    write_text(folder / "index.html", text)
    head = {"title": title, "ground_truth": None, "unrendered": dict(unrendered), "absent": dict(absent)}
    scores = json.dumps({**head, "scores": [asdict(s.score) for s in runs]}, indent=1, allow_nan=False)
    write_text(folder / "scores.json", scores + "\n")
    write_text(folder / MARKER.name, json.dumps({"content_hash": content_hash, "title": title}, indent=1) + "\n")
    return folder / "index.html"


def open_recorded(entries: ListOf[ReportEntry]) -> list[Shown]:
    """The runs of a report; one without results is missing."""
    sequences: dict[Path, Sequence] = {}
    labels: dict[str, int] = {}
    runs = []
    for entry in entries:
        if entry.sequence not in sequences:
            sequences[entry.sequence] = Sequence.load(entry.sequence)
        sequence, folder = sequences[entry.sequence], entry.results
        there = folder.exists() and not entry.why
        results = sound(Results.load(folder))[0] if there else missing_results(sequence, folder, entry.why)
        run = RecordedRun(sequence, results)
        score = RecordedScore.load(entry.score) if there else score_recorded(sequence, results)
        runs.append(Shown(run, score, labels.setdefault(score.label, len(labels))))
    return runs


def summary(runs: ListOf[Shown], absent: tuple[str, ...]) -> Table:
    """A row for each tracker and rate, its mean over sequences and seeds; without ground truth no row is best."""
    rows = []
    for name, of_run in runs_of(score_frame(asdict(shown.score) for shown in runs)).items():
        cells = []
        for column in COLUMNS:
            values = column.of(of_run)
            known = values[np.isfinite(values)]
            mean = float(known.mean()) if len(known) else None
            cells.append(
                Cell(mean=mean, interval=None, known=len(known), runs=len(values), decimals=column.decimals)
            )  # fmt: skip
        rows.append((name, tuple(cells)))
    return Table(CAPTION, COLUMNS, tuple(rows), absent)


def section(folder: Path, runs: ListOf[Shown]) -> dict[str, Any]:
    """Write figures and overlays of one sequence; its section of the page."""
    sequence = runs[0].run.sequence
    rates = sorted({shown.score.rate_hz for shown in runs}, reverse=True)
    figures = [
        figure.sized(folder)
        for rate in rates
        for figure in figures_of(folder, [s for s in runs if s.score.rate_hz == rate], rate)
    ]
    overlays = []
    for shown in (s for s in runs if s.score.rate_hz == rates[0]):
        path = folder / "figures" / f"overlay_{shown.slug}.webp"
        write_overlay(shown, path)
        overlays.append({"title": shown.title, "file": path.relative_to(folder).as_posix()})
    return {
        "frames": len(sequence),
        "seconds": float(sequence.stamps_ns[-1] - sequence.stamps_ns[0]) / 1e9,
        "figures": figures,
        "overlays": overlays,
    }


def figures_of(folder: Path, runs: ListOf[Shown], rate: float) -> list[FigureOnPage]:
    """Write the figures of edges met and of camera positions over time, at one rate (Hz)."""
    suffix = f"{runs[0].score.sequence}_{rate:g}hz"
    met = save_panel(partial(draw_edges_met, runs), folder / "figures" / f"met_{suffix}", 2.0)
    way = save_drawn(partial(draw_positions, runs), folder / "figures" / f"way_{suffix}", 3.2, wide=False)
    share = "Share of the visible model edges on an edge of the image; gaps: no pose."
    places = "In the model's frame; where trackers agree, chance is unlikely."
    return [
        on_page(folder, met, f"Edges met, {rate:g} Hz", share),
        on_page(folder, way, f"Camera positions, {rate:g} Hz", places),
    ]


def draw_edges_met(runs: ListOf[Shown], panel: Axes) -> Drawn:
    """Share of the visible edges (%) that meet an edge of the image, by time (s)."""
    rows: list[list[Any]] = []
    for shown in runs:
        panel.plot(shown.run.seconds, 100 * shown.run.edges_met, label=shown.score.label, **line(shown.colour))
        values = zip(shown.run.expected.tolist(), shown.run.seconds.tolist(), shown.run.edges_met.tolist(), strict=True)
        rows += [[shown.score.run, frame, t, finite(v)] for frame, t, v in values]
    panel.set(xlabel="time (s)", ylabel="edges met (%)", ylim=(0, 102))
    return Drawn(columns=["run", "frame", "time_s", "edges_met"], rows=rows, legend={"ncols": 3})


def draw_positions(runs: ListOf[Shown], figure: Figure) -> Drawn:
    """Position (cm) of the camera in the model's frame, by time (s)."""
    panels = figure.subplots(3, 1, sharex=True)
    rows: list[list[Any]] = []
    for shown in runs:
        results = shown.run.results
        t = (results.stamps_ns - shown.run.sequence.stamps_ns[0]) / 1e9
        at = np.full((len(results), 3), np.nan)
        at[results.ok] = results.estimate.positions_m
        for k, axis in enumerate(panels):
            axis.plot(t, 100 * at[:, k], label=shown.score.label, **line(shown.colour))
        rows += [[shown.score.run, s, *map(finite, p)] for s, p in zip(t.tolist(), at.tolist(), strict=True)]
    for name, axis in zip("xyz", panels, strict=True):
        axis.set_ylabel(f"{name} (cm)")
    panels[-1].set_xlabel("time (s)")
    return Drawn(columns=["run", "time_s", "x_m", "y_m", "z_m"], rows=rows, legend=legend_of(panels[0], {"ncols": 3}))


def write_overlay(shown: Shown, path: Path) -> None:
    """Write the model at the latest estimate on the images as an animated WebP; a frame without a pose says so."""
    sequence = shown.run.sequence
    rows = {int(f): row for f, row in zip(shown.run.results.frames, shown.run.results.rows, strict=True)}
    frames = shown.run.expected[scrubbed(len(shown.run.expected))].tolist()
    frames = frames[:: max(1, -(-len(frames) // MOST_OVERLAY_FRAMES))]
    pictures = []
    for frame in frames:
        view = View.of(sequence.image(frame), sequence.camera, sequence.structure)
        scale = min(1.0, ANIMATION_WIDTH_PX / view.image.shape[1])
        canvas = np.asarray(cv2.resize(view.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
        row = rows.get(frame)
        pose = row.cam_from_world if row else None
        draw(canvas, view.projected(pose) * scale, GREEN, 2)
        write_text_on(canvas, f"{shown.title}  frame {frame}  {row.status if row else 'no row'}")
        pictures.append(Pillow.fromarray(canvas[..., ::-1]))
    step_ms = round(float(np.diff(sequence.stamps_ns[frames]).mean()) / 1e6) if len(frames) > 1 else 100
    with new_file(path) as temporary:
        pictures[0].save(
            temporary, format="WEBP", save_all=True, append_images=pictures[1:], duration=step_ms, loop=0,
            quality=WEBP_QUALITY, method=0,
        )  # fmt: skip
