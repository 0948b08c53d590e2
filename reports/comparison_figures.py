"""The figures of a report that compare trackers over all sequences."""

from collections.abc import Sequence as ListOf
from functools import partial

from uavbench.reports.figures import comparison as figures_compare
from uavbench.reports.figures import distributions as figures_statistics
from uavbench.reports.figures import ranking
from uavbench.reports.figures.sweeps import sweep, swept
from uavbench.reports.report_figures import Drawing
from uavbench.reports.restarts import RestartedRun, error_after_anchors
from uavbench.reports.scoring.attributes import breakdowns, frames_looked_at
from uavbench.reports.scoring.crlb_ratio import SIGMA_PX, error_over_bound
from uavbench.reports.scoring.repeated_seeds import counted
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.scoring.score_frame import score_frame
from uavbench.reports.statistics.bootstrap import compare_pairs, ranks, units
from uavbench.reports.tables.summary_table import by_flight, runs_of
from uavbench.trajectories.pose import Array

RANKED_BY = "area over the success curve"


def compare(runs: ListOf[ScoredRun]) -> list[Drawing]:
    """Figures over all runs but repeated ones."""
    runs = counted(runs)
    colours = {run.name: run.colour for run in runs}
    fast = fastest(runs)
    fastest_hz = fast[0].score.rate_hz
    slower = "; hollow at the lower rates" if len(fast) < len(runs) else ""
    made = [
        Drawing("accuracy", "Error and coverage",
                "ATE (RMSE, no alignment) over the frames with a pose, next to the share of frames that have one and "
                "that are within 5 cm and 5\N{DEGREE SIGN} (dotted): every run, and the mean over runs. An error means "
                "little without its coverage.",
                partial(figures_compare.accuracy_and_coverage, runs)),
        Drawing("success", "Success curves",
                "Share of all frames within a distance of the ground truth; frames without a pose are within none.",
                partial(figures_compare.success_curves, runs)),
        Drawing("latency", "Accuracy against latency",
                f"Median time of a frame with a line to the 95th percentile{slower}.",
                partial(figures_compare.accuracy_against_latency, runs)),
        Drawing("attributes", f"Success by attribute, {fastest_hz:g} Hz",
                f"Success by quartile of each attribute that is known from the renderer{_share_looked_at(fast)}.",
                lambda stem: figures_statistics.by_attribute(breakdowns(fast), colours, stem), late=True),
    ]  # fmt: skip
    for rate in sorted({run.score.rate_hz for run in runs}, reverse=True):
        made += rank([run for run in runs if run.score.rate_hz == rate], colours, rate, always=rate == fastest_hz)
    made.append(bound(fast, colours))
    if any(run.score.consistency is not None for run in runs):
        caption = "Squared error over the claimed covariance; above the band the tracker is overconfident."
        made.append(Drawing("nees", "NEES", caption, partial(figures_statistics.nees_over_time, runs)))
    return made


def _share_looked_at(runs: ListOf[ScoredRun]) -> str:
    """How many frames of each tracker a breakdown looks at, "" for all of them."""
    looked_at = frames_looked_at(runs)
    of_one = [run for run in runs if run.name == runs[0].name]
    some, every = sum(len(looked_at[id(run)]) for run in of_one), sum(len(run.errors.frames) for run in of_one)
    return f", of {some} of {every} frames, evenly spaced" if some < every else ""


def fastest(runs: ListOf[ScoredRun]) -> list[ScoredRun]:
    """The runs at the highest rate."""
    fastest_hz = max(run.score.rate_hz for run in runs)
    return [run for run in runs if run.score.rate_hz == fastest_hz]


def bound(fast: ListOf[ScoredRun], colours: dict[str, int]) -> Drawing:
    """The errors at the highest rate over the Cramer-Rao bound of their frames, on the first sequence."""
    sequence = fast[0].sequence
    caption = (
        "Position error over the Cramer-Rao bound of the image's noise, of every frame that has one; 1 is the optimum "
        "from one frame for a tracker that knows the appearance of the structure."
        if sequence.pose_bounds
        else f"Position error of each frame over the Cramer-Rao bound of its edges, {SIGMA_PX} px of noise on each "
        "control point assumed; 1 is the optimum from the edges of one frame."
    )
    followed = {run.name: run.errors for run in fast if run.sequence is sequence}
    return Drawing(
        "bound",
        f"Error over the bound, {sequence.name}",
        caption,
        lambda stem: figures_statistics.error_over_bound(
            {name: error_over_bound(sequence, errors) for name, errors in followed.items()}, colours, stem
        ),
    )


def compare_restarts(runs: ListOf[ScoredRun], restarted: ListOf[RestartedRun]) -> list[Drawing]:
    """The figure over all runs restarted at anchors; none without such runs."""
    if not any(run.protocol == "anchors" for run in restarted):
        return []
    slower = "; lower rates are thin, with a mark at each frame" if len(fastest(runs)) < len(runs) else ""
    caption = f"Every run restarts from the true pose every 5 s; error since then, over all sequences{slower}."
    colours = {run.name: run.colour for run in runs}
    return [Drawing("anchors", "Error after an anchor", caption, partial(error_after_anchors, restarted, colours))]


def compare_along(runs: ListOf[ScoredRun]) -> list[Drawing]:
    """The curves of a suite whose sequences differ in one number; none for other suites."""
    found = swept(list({run.sequence.name: run.sequence for run in runs}.values()))
    if found is None:
        return []
    caption = (
        f"Against `{found.key}`, at the highest rate; bands: 95 % intervals over the seeds, where there are enough. "
        "The error is that of the frames with a pose: read it together with the success."
    )
    return [
        Drawing("sweep_ate", "Error along the sweep", caption, partial(sweep, runs, found, "ate")),
        Drawing("sweep_success", "Success along the sweep", caption, partial(sweep, runs, found, "success")),
    ]


def rank(runs: ListOf[ScoredRun], colours: dict[str, int], rate_hz: float, *, always: bool) -> list[Drawing]:
    """Mean ranks and wins at one rate, by the area over the success curve; none with one run or one tracker."""
    values = paired(runs)
    if not values:
        return []
    names = list(values)
    return [
        Drawing(f"ranks_{rate_hz:g}hz", f"Mean ranks, {rate_hz:g} Hz",
                "Best at the left; bars join trackers without a significant difference (Nemenyi).",
                lambda stem: ranking.critical_difference(
                    ranks({name: units(v) for name, v in values.items()}), colours, stem, RANKED_BY), always),
        Drawing(f"wins_{rate_hz:g}hz", f"Wins, {rate_hz:g} Hz",
                "Paired by sequence and seed; *: the mean difference is significant at the 5 % level.",
                lambda stem: ranking.win_table(names, compare_pairs(values), stem, RANKED_BY), always),
    ]  # fmt: skip


def paired(runs: ListOf[ScoredRun]) -> dict[str, list[Array]]:
    """Area over the success curve of each tracker, by flight and seed; empty when they cannot be compared.

    Runs that repeat another one are left out.
    """
    runs = counted(runs)
    names = list(dict.fromkeys(run.name for run in runs))
    keys = [sorted((r.score.flight, r.score.seed) for r in runs if r.name == name) for name in names]
    if len(names) < 2 or len(set(keys[0])) < 2 or any(key != keys[0] for key in keys):
        return {}
    of_run = runs_of(score_frame(run.score.to_json() for run in runs))
    return {name: by_flight(rows, 1 - rows["tracking_success_auc"].to_numpy()) for name, rows in of_run.items()}
