"""The report over scored runs: figures, tables, overlays and pages in one folder.

index.html                   the summary, failures first, and the figures
pages/SEQUENCE.html          frame by frame, with its images beside it
figures/*.pdf *.png *.csv    every figure and the numbers behind it
figures/overlay_*.webp       the model on the images, moving
tables/summary.* details.*   Markdown, CSV, LaTeX
scores.json                  all scores; byte for byte the same on every run of the same suite
latency.json                 the times of the same runs
report.json                  the hash of what made this report
"""

import json
from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, replace
from pathlib import Path

from reports import figures_pictures, figures_space, figures_time, flight_figure
from reports.overlay import scrubbed, write_frames
from reports.page import FigureOnPage, SequenceOnPage, on_page, write_index, write_sequence_page
from reports.report_compare import compare, compare_along, compare_restarts
from reports.restarts import COLUMNS as RESTARTS
from reports.restarts import numbers_of, open_restarts
from reports.runs import ScoredRun, open_runs
from reports.score import Score
from reports.steps import OnStep, Steps
from reports.style import house_style
from reports.tables import DETAILS, details, summary_table
from reports.tables_write import write_tables
from trajectories.errors import UserError
from trajectories.files import in_parts, write_text


@dataclass(frozen=True)
class ReportEntry:
    """One scored run: its sequence's folder, its results' folder, its score.json; or why there is no such result."""

    sequence: Path
    results: Path
    score: Path
    why: str = ""


@in_parts("report.json")
def write_report(
    folder: Path,
    title: str,
    entries: ListOf[ReportEntry],
    unrendered: Mapping[str, str] | None = None,
    *,
    restarts: ListOf[Path] = (),
    absent: Mapping[str, str] | None = None,
    content_hash: str = "",
    on_step: OnStep | None = None,
) -> Path:
    """Write the report of all entries into `folder`; the path of its index.html.

    unrendered: sequences that could not be made, and why; restarts: results of runs that were given true poses on the
    way; absent: trackers that are not on this machine, and why. UserError when there is no entry, or files of one are
    missing or do not belong together.
    """
    if not entries:
        raise UserError("a report needs at least one scored run")
    runs = open_runs([(e.sequence, e.results, e.score, e.why) for e in entries])
    by_sequence = {name: [r for r in runs if r.sequence.name == name] for name in dict.fromkeys(_names(runs))}
    steps = Steps(on_step, sum(len(scrubbed(len(group[0].sequence))) for group in by_sequence.values()), len(runs))
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    with house_style():
        restarted = open_restarts(restarts, [run.sequence for run in runs])
        overall = [
            *compare(folder, runs, steps), *compare_restarts(folder, runs, restarted), *compare_along(folder, runs)
        ]  # fmt: skip
        pages = [write_sequence(folder, title, group, steps) for group in by_sequence.values()]
    scores = [run.score for run in runs]
    summary = replace(summary_table(scores), absent=tuple(absent or {}))
    tables = [("summary", summary), ("details", summary_table(scores, DETAILS, details))]
    if restarted:
        tables.append(("protocols", summary_table(scores, RESTARTS, numbers_of(restarted))))
    for name, table in tables:
        write_tables(table, folder / "tables" / name)
    write_scores(folder, title, [run.score for run in runs], unrendered or {}, absent or {})
    figures = [*overall, *(f for _, few in pages for f in few)]
    index = write_index(folder, title, runs, tables, figures, [p for p, _ in pages], unrendered or {}, absent or {})
    steps.finish()
    write_text(folder / "report.json", json.dumps({"content_hash": content_hash, "title": title}, indent=1) + "\n")
    return index


def write_scores(
    folder: Path, title: str, scores: ListOf[Score], unrendered: Mapping[str, str], absent: Mapping[str, str]
) -> None:
    """Write `scores.json`, the same on every run, and `latency.json`, the times, which are not."""
    timed = ("latency", "deadline_misses", "replay")
    rows = [score.to_json() for score in scores]
    accuracy = [{key: row[key] for key in row if key not in timed} for row in rows]
    times = [{key: row[key] for key in ("label", "rate_hz", "seed", "sequence", *timed)} for row in rows]
    head = {"title": title, "unrendered": dict(unrendered), "absent": dict(absent)}
    for name, entries in (("scores", accuracy), ("latency", times)):
        text = json.dumps({**head, name: entries}, indent=1, allow_nan=False)
        write_text(folder / f"{name}.json", text + "\n")


def write_sequence(
    folder: Path, title: str, runs: ListOf[ScoredRun], steps: Steps
) -> tuple[SequenceOnPage, list[FigureOnPage]]:
    """Figures, overlay and page of one sequence; the page, and the figures that the index shows too."""
    sequence, main = runs[0].sequence, main_run(runs)
    slug, figures = main.slug.split("_")[0], folder / "figures"
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    made = flight_figure.flight(sequence, figures / f"flight_{slug}")
    index = [
        on_page(folder, made, f"Flight, {sequence.name}", "The true path, where the camera looked, and the structure.")
    ]
    for rate in rates:
        some = [run for run in runs if run.score.rate_hz == rate]
        made = figures_time.errors_over_time(some, figures / f"errors_{slug}_{rate:g}hz")
        index.append(on_page(folder, made, f"Errors over time, {sequence.name}, {rate:g} Hz",
                             "Against the truth, without alignment; dotted: 5 cm and 5\N{DEGREE SIGN}."))  # fmt: skip
        made = figures_space.paths(some, figures / f"path_{slug}_{rate:g}hz")
        index.append(on_page(folder, made, f"Paths, {sequence.name}, {rate:g} Hz",
                             "True and estimated paths around the structure, in 3-D and from above."))  # fmt: skip
        made = figures_space.error_against_distance(some, figures / f"distance_{slug}_{rate:g}hz")
        index.append(on_page(folder, made, f"Error against distance, {sequence.name}, {rate:g} Hz",
                             "Against the distance travelled, and over sub-trajectories (boxes: quartiles, whiskers 5 "
                             "and 95 %)."))  # fmt: skip
        steps(8)
    pictured = [run for run in runs if run.score.label == main.score.label and len(run.results)]
    for run in pictured:
        index += pictures_of(folder, run)
        steps(8)
    own = []
    for run in runs:
        made = figures_time.pose_components(run, figures / f"pose_{run.slug}")
        caption = "Six components of the body's pose in the structure's frame, estimate against truth."
        own.append(on_page(folder, made, f"Pose components, {run.title}", caption))
        steps(8)
    moving = figures / f"overlay_{main.slug}.webp"
    write_frames(main, folder / "pages" / slug, moving, steps)
    shown = SequenceOnPage(
        sequence.name,
        f"pages/{slug}.html",
        moving.relative_to(folder).as_posix(),
        f"{main.title}: the model at the latest estimate in green, at the truth in white.",
        f"{len(sequence)} frames, {main.errors.seconds[-1]:.1f} s.",
        f"The overlay shows {main.title}: the model at the "
        "latest estimate in green, at the truth in white. Its page goes through all runs frame by frame.",
    )
    on_page_too = [FigureOnPage(f.files, f.title, f.caption, up="../") for f in [*index, *own]]
    write_sequence_page(folder, title, shown, runs, on_page_too)
    return shown, [*index, *(f for f, run in zip(own, runs, strict=True) if run in pictured)]


def pictures_of(folder: Path, run: ScoredRun) -> list[FigureOnPage]:
    """The pictures of the published experiment, for one run."""
    figures = folder / "figures"
    where = f"{run.sequence.name}, {run.title}"
    return [
        on_page(folder, figures_pictures.segment_pictures(run, figures / f"segments_{run.slug}"),
                f"LSD segments, {where}", "Line segments of at least 15 px on selected frames, drawn and counted."),
        on_page(folder, figures_pictures.edge_pictures(run, figures / f"edges_{run.slug}"),
                f"Model edges on detected edges, {where}",
                "Visible model edges at the estimated pose (green) on the detected edges (white)."),
        on_page(folder, figures_pictures.next_frame_pictures(run, figures / f"next_{run.slug}"),
                f"Projection on the next frame, {where}",
                "Model at the pose of one tracked frame (green), drawn on the next; the truth there in white."),
        on_page(folder, figures_time.segment_counts(run, figures / f"counts_{run.slug}"),
                f"Counts, {where}", "Segments, control points and inliers in each frame; shaded: lost."),
    ]  # fmt: skip


def main_run(runs: ListOf[ScoredRun]) -> ScoredRun:
    """The run that the pictures are of: the one with segments or inliers and most success, at the highest rate."""

    def rank(run: ScoredRun) -> tuple[bool, float, bool, float]:
        found = [row.segments for row in run.results.rows]
        explains = any(row.inliers is not None for row in run.results.rows)
        return explains, run.score.rate_hz, any(n is not None for n in found), run.score.tracking.success

    return max(runs, key=rank)


def _names(runs: ListOf[ScoredRun]) -> list[str]:
    return [run.sequence.name for run in runs]
