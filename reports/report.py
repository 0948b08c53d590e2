"""The report over scored runs: figures, tables, overlays and pages in one folder.

index.html                   the summary, failures first, and the figures
pages/SEQUENCE.html          a sequence frame by frame, with its images
figures/*.pdf *.png *.csv    figures and the numbers behind them
figures/overlay_*.webp       the model on the images, moving
tables/summary.* details.*   Markdown, CSV, LaTeX

The figures that compare trackers are always drawn, and of a few sequences a page with an overlay, the flight, the
errors and the paths; the rest is drawn on request (`figures="all"`).

scores.json                  all scores; byte for byte the same on every run of the same suite
scores.csv                   the same as a tidy table, a row for each run
latency.json                 the times of the same runs
report.json                  the content hash of the report
"""

import json
from collections.abc import Callable, Iterator, Mapping, Set
from collections.abc import Sequence as ListOf
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from uavbench.reports.comparison_figures import compare, compare_along, compare_restarts, fastest
from uavbench.reports.figures import flight as flight_figure
from uavbench.reports.figures import image_panels as figures_pictures
from uavbench.reports.figures import space as figures_space
from uavbench.reports.figures import time as figures_time
from uavbench.reports.page.failures import own_runs
from uavbench.reports.page.overlay_animation import scrubbed, write_frames
from uavbench.reports.page.pages import (
    NamedTable,
    ReportNotes,
    SequenceOnPage,
    Undrawn,
    write_index,
    write_sequence_page,
)
from uavbench.reports.page.templates import FigureOnPage
from uavbench.reports.progress import OnStep, Steps
from uavbench.reports.report_figures import WEIGHT, Drawing, Easel, Figures
from uavbench.reports.restarts import COLUMNS as RESTARTS
from uavbench.reports.restarts import RestartedRun, open_restarts, with_restarts
from uavbench.reports.scoring.attributes import contrast_at, frames_looked_at
from uavbench.reports.scoring.repeated_seeds import counted, repeats_of
from uavbench.reports.scoring.runs import ReportEntry, ScoredRun, open_runs
from uavbench.reports.scoring.score import Score
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.scoring.seen import TIMED
from uavbench.reports.style import house_style
from uavbench.reports.tables.columns import COLUMNS, DETAILS
from uavbench.reports.tables.summary_table import not_rendered, noted, summary_table
from uavbench.reports.tables.writers import write_summary, write_tables
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import in_parts, write_text

MARKER = Marker("report.json", "report")
PAGES = 3
"""Number of sequences that get a page by default."""


@dataclass(frozen=True)
class ReportInputs:
    """Inputs of a report.

    entries: its scored runs; restarts: results folders of runs that were restarted from true poses; unrendered:
    sequences that could not be rendered, and why; absent: trackers that are not installed, and why.
    """

    title: str
    entries: ListOf[ReportEntry]
    restarts: ListOf[Path] = ()
    unrendered: Mapping[str, str] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)


@in_parts(MARKER)
def write_report(
    folder: Path,
    inputs: ReportInputs,
    *,
    figures: Figures = "page",
    content_hash: str = "",
    on_step: OnStep | None = None,
) -> Path:
    """Write a report into `folder`, with the figures of the page or all of them; the path of its index.html.

    UserError when there is no entry, or the files of an entry are missing or inconsistent.
    """
    if not inputs.entries:
        raise UserError("a report needs at least one scored run")
    title = inputs.title
    runs = open_runs(inputs.entries)
    groups = {
        name: [r for r in runs if r.sequence.name == name] for name in dict.fromkeys(r.sequence.name for r in runs)
    }
    restarted = open_restarts(inputs.restarts, [run.sequence for run in runs])
    overall = [*compare(runs), *compare_restarts(runs, restarted), *compare_along(runs)]
    shown = groups if figures == "all" else looked_at(groups)
    first = next(iter(shown))
    of_sequence = {name: drawings_of(group, always=name == first) for name, group in groups.items()}
    count = sum(d.always or figures == "all" for d in [*overall, *(d for few in of_sequence.values() for d in few)])
    steps = Steps(on_step, sum(len(scrubbed(len(group[0].sequence))) for group in shown.values()) + WEIGHT * count)
    easel = Easel(folder, figures, steps)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    contrasted = frames_looked_at(fastest(runs))

    def overlays() -> None:
        for group in shown.values():
            write_overlay(folder, group, {frame for run in group for frame in contrasted.get(id(run), ())}, steps)

    with beside(overlays, steps), house_style():
        drawn = {name: easel.draw(few) for name, few in of_sequence.items()}
        on_index = easel.draw(overall)
    pages = [write_sequence(folder, title, group, drawn[name]) for name, group in shown.items()]
    on_index += drawn[first]
    tables = write_all_tables(folder, inputs, runs, restarted)
    write_scores(folder, inputs, [run.score for run in runs])
    undrawn = Undrawn(easel.left_out, tuple(name for name in groups if name not in shown))
    about = ReportNotes(title, inputs.unrendered, inputs.absent, undrawn)
    index = write_index(folder, about, runs, tables, on_index, pages)
    steps.finish()
    write_text(folder / MARKER.name, json.dumps({"content_hash": content_hash, "title": title}, indent=1) + "\n")
    return index


def write_all_tables(
    folder: Path, inputs: ReportInputs, runs: ListOf[ScoredRun], restarted: ListOf[RestartedRun]
) -> list[NamedTable]:
    """Write the tables as Markdown, CSV and LaTeX, and return them."""
    frame, repeats = score_frame(run.score.to_json() for run in counted(runs)), str(repeats_of(runs))
    missing = not_rendered(inputs.unrendered)
    summary, more = (noted(noted(summary_table(frame, columns), repeats), missing) for columns in (COLUMNS, DETAILS))
    summary = replace(summary, absent=tuple(inputs.absent))
    write_summary(summary, folder / "tables" / "summary")
    write_tables(more, folder / "tables" / "details")
    tables = [NamedTable("summary", summary), NamedTable("details", more)]
    if restarted:
        protocols = noted(summary_table(with_restarts(frame, restarted), RESTARTS), missing)
        tables.append(NamedTable("protocols", protocols))
        write_tables(tables[-1].table, folder / "tables" / "protocols")
    return tables


def looked_at(groups: Mapping[str, list[ScoredRun]]) -> dict[str, list[ScoredRun]]:
    """The sequences that get a page by default: the first, and those with the lowest success, PAGES in all."""
    first, *others = groups
    worst = sorted(others, key=lambda name: min(run.score.tracking.success for run in own_runs(groups[name])))
    return {name: groups[name] for name in (first, *worst[: PAGES - 1])}


def write_scores(folder: Path, inputs: ReportInputs, scores: ListOf[Score]) -> None:
    """Write `scores.json` and its numbers as `scores.csv`, the same on every run, and `latency.json`, which is not.

    The JSON is that of each `Score`: records and reasons why an error is undefined have no place in a tidy table.
    """
    rows = [score.to_json() for score in scores]
    accuracy = [{key: row[key] for key in row if key not in TIMED} for row in rows]
    times = [{key: row[key] for key in ("label", "rate_hz", "seed", "sequence", *TIMED)} for row in rows]
    head = {"title": inputs.title, "unrendered": dict(inputs.unrendered), "absent": dict(inputs.absent)}
    for name, entries in (("scores", accuracy), ("latency", times)):
        text = json.dumps({**head, name: entries}, indent=1, allow_nan=False)
        write_text(folder / f"{name}.json", text + "\n")
    write_text(folder / "scores.csv", score_frame(accuracy).to_csv(index=False, lineterminator="\n"))


@contextmanager
def beside(work: Callable[[], object], steps: Steps) -> Iterator[None]:
    """Do `work` on a thread while the body runs; image libraries release the interpreter lock.

    An error of the body ends the work at its next step.
    """
    with ThreadPoolExecutor(1) as thread:
        done = thread.submit(copy_context().run, work)
        try:
            yield
        except BaseException:
            steps.stop()
            raise
        done.result()


def write_overlay(folder: Path, runs: ListOf[ScoredRun], looked_at: Set[int], steps: Steps) -> None:
    """Write the frames of one sequence for its page, and its overlay; caches the contrast of the breakdown's frames."""
    main = main_run(runs)

    def on_frame(frame: int) -> None:
        steps()
        if frame in looked_at:
            contrast_at(main.sequence, frame)

    write_frames(main, folder / "pages" / slug_of(main.sequence), moving_of(folder, main), on_frame)


def moving_of(folder: Path, main: ScoredRun) -> Path:
    """File of the overlay of a sequence's main run."""
    return folder / "figures" / f"overlay_{main.slug}.webp"


def write_sequence(folder: Path, title: str, runs: ListOf[ScoredRun], figures: ListOf[FigureOnPage]) -> SequenceOnPage:
    """Page of one sequence."""
    sequence, main = runs[0].sequence, main_run(runs)
    shown = SequenceOnPage(
        sequence.name,
        f"pages/{slug_of(sequence)}.html",
        moving_of(folder, main).relative_to(folder).as_posix(),
        f"{main.title}: the model at the latest estimate in green, at the ground truth in white.",
        f"{len(sequence)} frames, {main.errors.seconds[-1]:.1f} s.",
        f"The overlay shows {main.title}: the model at the "
        "latest estimate in green, at the ground truth in white. Its page goes through all runs frame by frame.",
    )
    write_sequence_page(folder, title, shown, runs, [replace(figure, up="../") for figure in figures])
    return shown


def drawings_of(runs: ListOf[ScoredRun], *, always: bool) -> list[Drawing]:
    """Figures of one sequence; always: draw its flight, and errors and paths at the highest rate, by default."""
    sequence, main = runs[0].sequence, main_run(runs)
    name, slug = sequence.name, slug_of(sequence)
    made = [
        Drawing(f"flight_{slug}", f"Flight, {name}", "The true path, where the camera looked, and the structure.",
                partial(flight_figure.flight, sequence), always)
    ]  # fmt: skip
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    for rate in rates:
        some = [run for run in runs if run.score.rate_hz == rate]
        first = always and rate == rates[0]
        made += [
            Drawing(f"errors_{slug}_{rate:g}hz", f"Errors over time, {name}, {rate:g} Hz",
                    "Against the ground truth, without alignment; dotted: 5 cm and 5\N{DEGREE SIGN}; "
                    "strips: off target, "
                    "beyond either or without a pose.", partial(figures_time.errors_over_time, some), first),
            Drawing(f"path_{slug}_{rate:g}hz", f"Paths, {name}, {rate:g} Hz",
                    "True and estimated paths around the structure, in 3-D and from above.",
                    partial(figures_space.paths, some), first),
            Drawing(f"distance_{slug}_{rate:g}hz", f"Error against distance, {name}, {rate:g} Hz",
                    "Against the distance travelled, and over sub-trajectories, where the rate has them (boxes: "
                    "quartiles, whiskers 5 and 95 %).", partial(figures_space.error_against_distance, some), False),
        ]  # fmt: skip
    for run in runs:
        if run.score.label == main.score.label and len(run.results):
            made += pictures_of(run)
        caption = "Six components of the body's pose in the structure's frame, estimate against ground truth."
        draw = partial(figures_time.pose_components, run)
        made.append(Drawing(f"pose_{run.slug}", f"Pose components, {name}, {run.title}", caption, draw, False))
    return made


def pictures_of(run: ScoredRun) -> list[Drawing]:
    """The pictures of the published experiment, for one run."""
    where = f"{run.sequence.name}, {run.title}"
    return [
        Drawing(f"segments_{run.slug}", f"LSD segments, {where}",
                "Line segments of at least 15 px on selected frames, drawn and counted.",
                partial(figures_pictures.segment_pictures, run), False),
        Drawing(f"edges_{run.slug}", f"Model edges on detected edges, {where}",
                "Visible model edges at the estimated pose (green) on the detected edges (white).",
                partial(figures_pictures.edge_pictures, run), False),
        Drawing(f"next_{run.slug}", f"Projection on the next frame, {where}",
                "Model at the pose of one tracked frame (green), drawn on the next; the ground truth there in white.",
                partial(figures_pictures.next_frame_pictures, run), False),
        Drawing(f"counts_{run.slug}", f"Counts, {where}",
                "Segments, control points and inliers in each frame; shaded: off target.",
                partial(figures_time.segment_counts, run), False),
    ]  # fmt: skip


def slug_of(sequence: Sequence) -> str:
    """Name of a sequence as a file name."""
    return sequence.name.replace("/", "-").replace(" ", "-").replace(":", "-")


def main_run(runs: ListOf[ScoredRun]) -> ScoredRun:
    """The run shown in pictures: the most successful one at the highest rate, with segments or inliers if any has."""

    def rank(run: ScoredRun) -> tuple[bool, float, bool, float]:
        found = [row.segments for row in run.results.rows]
        explains = any(row.inliers is not None for row in run.results.rows)
        return explains, run.score.rate_hz, any(n is not None for n in found), run.score.tracking.success

    return max(runs, key=rank)
