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
from collections.abc import Callable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reports import figures_compare, figures_pictures, figures_space, figures_statistics, figures_time, flight_figure
from reports.attributes import breakdowns
from reports.bounds import SIGMA_PX, error_over_bound
from reports.overlay import scrubbed, write_frames
from reports.page import FigureOnPage, SequenceOnPage, write_index, write_sequence_page
from reports.restarts import COLUMNS as RESTARTS
from reports.restarts import RestartedRun, error_after_anchors, numbers_of, open_restarts
from reports.runs import ScoredRun, open_runs
from reports.score import Score
from reports.statistics import compare_pairs, ranks
from reports.style import house_style
from reports.tables import DETAILS, details, summary_table
from reports.tables_write import write_tables
from trajectories.errors import UserError
from trajectories.files import write_text
from trajectories.pose import Array

OnStep = Callable[[int, int], None]


@dataclass(frozen=True)
class ReportEntry:
    """One scored run: its sequence's folder, its results' folder, its score.json; or why there is no such result."""

    sequence: Path
    results: Path
    score: Path
    why: str = ""


def write_report(
    folder: Path,
    title: str,
    entries: ListOf[ReportEntry],
    unrendered: Mapping[str, str] | None = None,
    *,
    restarts: ListOf[Path] = (),
    content_hash: str = "",
    on_step: OnStep | None = None,
) -> Path:
    """Write the report of all entries into `folder`; the path of its index.html.

    unrendered: sequences that could not be made, and why; restarts: results of runs that were given true poses on the
    way. UserError when there is no entry, or files of one are missing or do not belong together.
    """
    if not entries:
        raise UserError("a report needs at least one scored run")
    runs = open_runs([(e.sequence, e.results, e.score, e.why) for e in entries])
    by_sequence = {name: [r for r in runs if r.sequence.name == name] for name in dict.fromkeys(_names(runs))}
    steps = Steps(on_step, sum(len(scrubbed(len(group[0].sequence))) for group in by_sequence.values()), len(runs))
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    with house_style():
        restarted = open_restarts(restarts, [run.sequence for run in runs])
        overall = [*compare(folder, runs, steps), *compare_restarts(folder, runs, restarted)]
        pages = [write_sequence(folder, title, group, steps) for group in by_sequence.values()]
    scores = [run.score for run in runs]
    tables = [("summary", summary_table(scores)), ("details", summary_table(scores, DETAILS, details))]
    if restarted:
        tables.append(("protocols", summary_table(scores, RESTARTS, numbers_of(restarted))))
    for name, table in tables:
        write_tables(table, folder / "tables" / name)
    write_scores(folder, title, [run.score for run in runs], unrendered or {})
    figures = [*overall, *(f for _, few in pages for f in few)]
    index = write_index(folder, title, runs, tables, figures, [p for p, _ in pages], unrendered or {})
    steps.finish()
    write_text(folder / "report.json", json.dumps({"content_hash": content_hash, "title": title}, indent=1) + "\n")
    return index


def write_scores(folder: Path, title: str, scores: ListOf[Score], unrendered: Mapping[str, str]) -> None:
    """Write `scores.json`, the same on every run, and `latency.json`, the times, which are not."""
    timed = ("latency", "deadline_misses", "replay")
    rows = [score.to_json() for score in scores]
    accuracy = [{key: row[key] for key in row if key not in timed} for row in rows]
    times = [{key: row[key] for key in ("label", "rate_hz", "seed", "sequence", *timed)} for row in rows]
    for name, entries in (("scores", accuracy), ("latency", times)):
        text = json.dumps({"title": title, "unrendered": dict(unrendered), name: entries}, indent=1, allow_nan=False)
        write_text(folder / f"{name}.json", text + "\n")


class Steps:
    """Progress: a figure weighs as much as eight frames."""

    def __init__(self, on_step: OnStep | None, frames: int, runs: int) -> None:
        self._on_step = on_step
        self._total = frames + 8 * (3 + 4 * runs)
        self._done = 0

    def __call__(self, weight: int = 1) -> None:
        """Tell that so much more is done."""
        self._tell(min(self._done + weight, self._total))

    def finish(self) -> None:
        """Tell that all is done."""
        self._tell(self._total)

    def _tell(self, done: int) -> None:
        self._done = done
        if self._on_step is not None:
            self._on_step(self._done, self._total)


def compare(folder: Path, runs: ListOf[ScoredRun], steps: Steps) -> list[FigureOnPage]:
    """Figures over all runs."""
    figures = folder / "figures"
    colours = {run.name: run.colour for run in runs}
    made = [
        on_page(folder, figures_compare.accuracy_and_coverage(runs, figures / "accuracy"), "Error and coverage",
                "ATE (RMSE, no alignment) over the frames with a pose, beside the share of frames that have one and "
                "that are within 5 cm and 5\N{DEGREE SIGN} (dotted). An error means little without its coverage."),
        on_page(folder, figures_compare.success_curves(runs, figures / "success"), "Success curves",
                "Share of all frames within a distance of the truth; lost frames are within none."),
        on_page(folder, figures_compare.accuracy_against_latency(runs, figures / "latency"), "Accuracy against latency",
                "Median time of a frame with a line to the 95th percentile; hollow at the lower rates."),
    ]  # fmt: skip
    steps(16)
    fast = [run for run in runs if run.score.rate_hz == max(r.score.rate_hz for r in runs)]
    parts = figures_statistics.by_attribute(breakdowns(fast), colours, figures / "attributes")
    made.append(on_page(folder, parts, f"Why they fail, {fast[0].score.rate_hz:g} Hz",
                        "Success in the quarters of the frames by what the renderer knows of them."))  # fmt: skip
    steps(8)
    for rate in sorted({run.score.rate_hz for run in runs}, reverse=True):
        made += rank(folder, [run for run in runs if run.score.rate_hz == rate], colours, f"{rate:g}hz")
    bounded = fast[0].sequence
    followed = {run.name: error_over_bound(bounded, run.errors) for run in fast if run.sequence is bounded}
    files = figures_statistics.error_over_bound(followed, colours, figures / "bound")
    caption = (
        "Position error over the Cramer-Rao bound of the image's noise, of every frame that has one; 1 is as good as "
        "one frame allows a tracker that knows how the structure looks."
        if bounded.pose_bounds
        else f"Position error of each frame over the Cramer-Rao bound of its edges, {SIGMA_PX} px of noise on each "
        "control point assumed; 1 is as good as one frame's edges allow."
    )
    made.append(on_page(folder, files, f"Error over the bound, {bounded.name}", caption))
    if any(run.score.consistency is not None for run in runs):
        files = figures_statistics.nees_over_time(runs, figures / "nees")
        caption = "Squared error over the claimed covariance; above the band it claims too much."
        made.append(on_page(folder, files, "NEES", caption))
    return made


def compare_restarts(folder: Path, runs: ListOf[ScoredRun], restarted: ListOf[RestartedRun]) -> list[FigureOnPage]:
    """The figure over all runs from anchors; none without such runs."""
    if not any(run.protocol == "anchors" for run in restarted):
        return []
    files = error_after_anchors(restarted, {run.name: run.colour for run in runs}, folder / "figures" / "anchors")
    caption = "Every run starts from the true pose every 5 s: what became of it since, over all sequences."
    return [on_page(folder, files, "Error after an anchor", caption)]


def rank(folder: Path, runs: ListOf[ScoredRun], colours: dict[str, int], suffix: str) -> list[FigureOnPage]:
    """Mean ranks and wins at one rate, by the area over the success curve; none with one run or one tracker."""
    names = list(dict.fromkeys(run.name for run in runs))
    keys = [sorted((r.sequence.name, r.score.seed) for r in runs if r.name == name) for name in names]
    if len(names) < 2 or len(keys[0]) < 2 or any(key != keys[0] for key in keys):
        return []
    values: dict[str, list[Array]] = {}
    for name in names:
        group = sorted((r for r in runs if r.name == name), key=lambda r: (r.sequence.name, r.score.seed))
        values[name] = [
            np.array([1 - r.score.tracking.success_auc for r in group if r.sequence.name == sequence])
            for sequence in dict.fromkeys(r.sequence.name for r in group)
        ]
    figures, what = folder / "figures", "area over the success curve"
    found = ranks({name: np.concatenate(v) for name, v in values.items()})
    return [
        on_page(folder, figures_statistics.critical_difference(found, colours, figures / f"ranks_{suffix}", what),
                "Mean ranks", "Best at the left; bars join trackers that Nemenyi's test does not tell apart."),
        on_page(folder, figures_statistics.win_table(names, compare_pairs(values), figures / f"wins_{suffix}", what),
                "Wins", "Paired by sequence and seed; *: the mean difference stands at the 5 % level."),
    ]  # fmt: skip


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


def on_page(folder: Path, files: ListOf[Path], title: str, caption: str) -> FigureOnPage:
    """A figure with its files relative to the report."""
    return FigureOnPage(tuple(path.relative_to(folder).as_posix() for path in files), title, caption)


def _names(runs: ListOf[ScoredRun]) -> list[str]:
    return [run.sequence.name for run in runs]
