"""Figures over time: the six pose components, errors, and segment counts."""

from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn, save_panel
from uavbench.reports.figures.logarithmic import logarithmic, plain_powers
from uavbench.reports.metrics.association import NS
from uavbench.reports.metrics.frame_errors import SUCCESS_DEG, SUCCESS_M
from uavbench.reports.scoring.coverage import failures
from uavbench.reports.scoring.runs import ScoredRun, counts
from uavbench.reports.style import GROUND_TRUTH, LOSS, colour, dots_where_alone, line, short_names
from uavbench.reports.uncertainty.nees import component_sigmas, euler_zyx
from uavbench.tracker.results import evaluated_poses
from uavbench.trajectories.pose import Array

COMPONENTS = (("x", "cm"), ("y", "cm"), ("z", "cm"), ("roll", "deg"), ("pitch", "deg"), ("yaw", "deg"))
Quantity = Literal["position", "rotation"]
TO_SHOWN_UNITS = np.array([100.0] * 3 + [float(np.degrees(1.0))] * 3)


def pose_components(run: ScoredRun, stem: Path) -> list[Path]:
    """Write `draw_pose_components` as files at a stem; their paths."""
    return save_drawn(partial(draw_pose_components, run), stem, 3.1)


def draw_pose_components(run: ScoredRun, figure: Figure | SubFigure) -> Drawn:
    """Six components of world_from_body in cm and deg: estimate with its claimed 3-sigma band, and ground truth."""
    t, frames = run.errors.seconds, run.errors.frames
    full = evaluated_poses(run.sequence)
    t_full = (full.stamps_ns - full.stamps_ns[0]) / NS
    ground_truth = true_components(run)
    estimate = estimated_components(run, ground_truth[frames])
    sigma = np.full((len(frames), 6), np.nan)
    sigma[np.searchsorted(frames, run.results.frames)] = component_sigmas(run.results) * TO_SHOWN_UNITS
    axes = figure.subplots(2, 3, sharex=True)
    sparse = len(t) < 80
    for k, ((name, unit), panel) in enumerate(zip(COMPONENTS, axes.flat, strict=True)):
        shade_failures(panel, t, run.errors.success)
        panel.plot(t_full, ground_truth[:, k], color=GROUND_TRUTH, lw=1.4, label="ground truth")
        low, high = estimate[:, k] - 3 * sigma[:, k], estimate[:, k] + 3 * sigma[:, k]
        if np.isfinite(low).any():
            panel.fill_between(t, low, high, color=colour(run.colour), alpha=0.25, lw=0, label=r"claimed $3\sigma$")
        dots = dots_where_alone(estimate[:, k])
        style = {"marker": "o", "ms": 2.5, "lw": 0.7} if sparse else {"lw": 0.9, **dots}
        panel.plot(t, estimate[:, k], color=colour(run.colour), ls=(0, (4, 1)), label=run.title, **style)
        panel.set_ylabel(f"{name} ({unit})" if unit == "cm" else f"{name} (deg)")
        margin_around(panel, ground_truth[:, k], estimate[:, k])
    for panel in axes[1]:
        panel.set_xlabel("time (s)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if not run.errors.success.all():
        handles.append(Patch(color=LOSS))
        labels.append("off target: no pose within 5 cm and 5 deg")
    names = [f"{n}_{u}" for n, u in COMPONENTS]
    columns = [f"{what}_{n}" for what in ("true", "estimated", "sigma") for n in names]
    values = np.hstack([ground_truth[frames], estimate, sigma]).tolist()
    rows = ([f, s, *map(finite, v)] for f, s, v in zip(frames.tolist(), t.tolist(), values, strict=True))
    legend = {"handles": handles, "labels": labels, "ncols": 4}
    return Drawn(columns=["frame", "time_s", *columns], rows=rows, legend=legend)


def errors_over_time(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_errors_over_time` as files at a stem; their paths."""
    return save_drawn(partial(draw_errors_over_time, runs), stem, 2.6 + 0.13 * len(runs))


def draw_errors_over_time(runs: ListOf[ScoredRun], figure: Figure | SubFigure) -> Drawn:
    """Position (cm) and rotation (deg) error of every run over time; a strip per run marks frames without success."""
    grid = figure.add_gridspec(3, 1, height_ratios=[10, 10, 1.2 * len(runs)])
    top = figure.add_subplot(grid[0])
    below = figure.add_subplot(grid[1], sharex=top)
    strip = figure.add_subplot(grid[2], sharex=top)
    draw_error_over_time(runs, "position", top)
    draw_error_over_time(runs, "rotation", below)
    rows: list[list[Any]] = []
    for k, run in enumerate(runs):
        errors, t = run.errors, run.errors.seconds
        for a, b in spans(t, ~errors.success):
            low, high = 1 - (k + 0.9) / len(runs), 1 - (k + 0.1) / len(runs)
            strip.axvspan(a, b, ymin=low, ymax=high, color=colour(run.colour), lw=0)
        columns = (errors.frames, t, errors.translation_m, errors.angle_deg, errors.success)
        rows += [
            [run.name, frame, seconds, finite(metres), finite(degrees), int(success)]
            for frame, seconds, metres, degrees, success in zip(*(c.tolist() for c in columns), strict=True)
        ]
    for panel in (top, below):
        panel.tick_params(labelbottom=False)
    middles = [1 - (k + 0.5) / len(runs) for k in range(len(runs))]
    strip.set_yticks(middles, short_names([run.score.label for run in runs]), fontsize=6)
    strip.set_ylim(0, 1)
    strip.grid(False)
    strip.set_xlabel("time (s)")
    strip.set_ylabel("off\ntarget", rotation=0, ha="right", va="center", fontsize=7)
    named = ["run", "frame", "time_s", "position_m", "rotation_deg", "success"]
    return Drawn(columns=named, rows=rows, legend=legend_of(top, {"ncols": 6}))


def draw_error_over_time(runs: ListOf[ScoredRun], quantity: Quantity, panel: Axes) -> None:
    """Draw the position (cm) or rotation (deg) error of every run over time (s), and the limit of success, dotted."""
    for run in runs:
        errors, t = run.errors, run.errors.seconds
        values = 100 * errors.translation_m if quantity == "position" else errors.angle_deg
        values = np.where(errors.ok, values, np.nan)
        shown = {"marker": "o", "ms": 2.5} if len(t) < 80 else dots_where_alone(values)
        panel.plot(t, values, label=run.title, **line(run.colour), **shown)
    logarithmic(panel.yaxis)
    panel.axhline(100 * SUCCESS_M if quantity == "position" else SUCCESS_DEG, color=GROUND_TRUTH, lw=0.6, ls=":")
    panel.set_ylabel(f"{quantity} error ({'cm' if quantity == 'position' else 'deg'})")
    nice_log(panel)


def segment_counts(run: ScoredRun, stem: Path) -> list[Path]:
    """Write `draw_segment_counts` as files at a stem; their paths."""
    return save_panel(partial(draw_segment_counts, run), stem, 1.9)


def draw_segment_counts(run: ScoredRun, panel: Axes) -> Drawn:
    """Numbers of detected segments, control points, and inliers of the pose in each frame."""
    t = (run.results.stamps_ns - run.sequence.stamps_ns[0]) / NS
    names = {"segments": "segments", "control_points": "control points", "inliers": "inliers"}
    shown = {label: counts(run.results, name) for name, label in names.items()}
    shade_failures(panel, run.errors.seconds, run.errors.success)
    for k, (label, values) in enumerate(shown.items()):
        if np.isfinite(values).any():
            panel.plot(t, values, label=label, **line(k), **dots_where_alone(values))
    panel.set_xlabel("time (s)")
    panel.set_ylabel("count per frame")
    panel.set_ylim(bottom=0)
    table = np.column_stack([t, *shown.values()]).tolist()
    rows = ([f, *map(finite, v)] for f, v in zip(run.results.frames.tolist(), table, strict=True))
    return Drawn(columns=["frame", "time_s", *names], rows=rows, legend={"ncols": 3})


def true_components(run: ScoredRun) -> Array:
    """True x y z in cm and unwrapped roll pitch yaw in deg (n, 6) of the body in every frame of the sequence."""
    ground_truth = evaluated_poses(run.sequence)
    angles = np.unwrap(euler_zyx(ground_truth.quaternions_wxyz), axis=0)
    values: Array = np.hstack([ground_truth.positions_m, angles]) * TO_SHOWN_UNITS
    return values


def estimated_components(run: ScoredRun, ground_truth: Array) -> Array:
    """Estimated x y z in cm and roll pitch yaw in deg (n, 6) of the expected frames; NaN without a pose.

    ground_truth (n, 6): of the same frames, as `true_components`; the angles are within 180 deg of it.
    """
    pairs = run.errors.pairs
    values: Array = np.hstack([pairs.estimate_m, euler_zyx(pairs.estimate_q)]) * TO_SHOWN_UNITS
    values[:, 3:] = ground_truth[:, 3:] + (values[:, 3:] - ground_truth[:, 3:] + 180) % 360 - 180
    return values


def margin_around(panel: Axes, ground_truth: Array, estimate: Array) -> None:
    """Limit y to the ground truth and the estimates within its spread of it, so that outliers do not hide it."""
    low, high = float(ground_truth.min()), float(ground_truth.max())
    spread = max(high - low, 2.0)
    kept = estimate[(estimate > low - spread) & (estimate < high + spread)]
    low, high = min(low, *kept, low), max(high, *kept, high)
    panel.set_ylim(low - 0.06 * (high - low + 1), high + 0.06 * (high - low + 1))


def nice_log(panel: Axes) -> None:
    """Plain numbers on a logarithmic y axis, which starts at 0.01 or above."""
    panel.set_ylim(bottom=max(panel.get_ylim()[0], 0.01))
    plain_powers(panel.yaxis)


def shade_failures(panel: Axes, t: Array, success: NDArray[np.bool_]) -> None:
    """Shade the times t (n,) in s without a pose within 5 cm and 5 deg."""
    for a, b in spans(t, ~success):
        panel.axvspan(a, b, color=LOSS, lw=0, zorder=0.5)


def spans(t: Array, on: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Intervals (start, end) of the times t (n,) where `on` holds; each time extends halfway to its neighbours."""
    if len(t) < 2:
        return [(float(t[0]) - 0.5, float(t[0]) + 0.5)] if on.any() else []
    borders = np.concatenate([[t[0]], (t[1:] + t[:-1]) / 2, [t[-1]]])
    begins, ends = failures(~on)
    return [(float(borders[a]), float(borders[b])) for a, b in zip(begins, ends, strict=True)]
