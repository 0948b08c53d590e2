"""The figures of a report that compare trackers over all sequences."""

from collections.abc import Sequence as ListOf
from pathlib import Path

import numpy as np

from reports import figures_compare, figures_statistics
from reports.attributes import breakdowns
from reports.bounds import SIGMA_PX, error_over_bound
from reports.page import FigureOnPage, on_page
from reports.restarts import RestartedRun, error_after_anchors
from reports.runs import ScoredRun
from reports.statistics import compare_pairs, ranks
from reports.steps import Steps
from reports.sweeps import sweep_figures, swept
from trajectories.pose import Array


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


def compare_along(folder: Path, runs: ListOf[ScoredRun]) -> list[FigureOnPage]:
    """The curves of a suite whose sequences differ in one number; none for other suites."""
    found = swept(list({run.sequence.name: run.sequence for run in runs}.values()))
    if found is None:
        return []
    caption = (
        f"Against `{found.key}`, at the highest rate; bands: 95 % intervals over the seeds. The error is that of the "
        "frames with a pose: read it with the success."
    )
    titles = ("Error along the sweep", "Success along the sweep")
    made = zip(sweep_figures(runs, found, folder / "figures"), titles, strict=True)
    return [on_page(folder, files, title, caption) for files, title in made]


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
