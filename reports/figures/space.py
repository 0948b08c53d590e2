"""Figures in space: paths in 3-D and from above over the structure, error against distance, over sub-trajectories."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn
from uavbench.reports.figures.logarithmic import logarithmic
from uavbench.reports.figures.time import nice_log
from uavbench.reports.metrics.rpe import PairInterval, interval_pairs, relative_errors
from uavbench.reports.metrics.sub_trajectories import distance_along
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.style import GROUND_TRUTH, colour, dots_where_alone, line, panel_letter
from uavbench.scenes.structure import Structure
from uavbench.tracker.results import evaluated_poses
from uavbench.trajectories.pose import Array

SHARES = (0.05, 0.1, 0.2, 0.4)


def paths(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_paths` as files at a stem; their paths."""
    return save_drawn(partial(draw_paths, runs), stem, 3.2)


def draw_paths(runs: ListOf[ScoredRun], figure: Figure | SubFigure) -> Drawn:
    """True and estimated paths of runs on one sequence, in 3-D and from above, with the structure; in m."""
    solid: Any = figure.add_subplot(1, 2, 1, projection="3d")
    flat = figure.add_subplot(1, 2, 2)
    sequence = runs[0].sequence
    ground_truth = evaluated_poses(sequence).positions_m
    draw_paths_from_above(runs, flat)
    edges = np.insert(sequence.structure.edge_segments, 2, np.nan, axis=1).reshape(-1, 3)
    solid.plot(*edges.T, color="#8A7F70", lw=0.6)
    solid.plot(*ground_truth.T, color=GROUND_TRUTH, lw=1.4)
    rows: list[list[Any]] = [["ground truth", i, *p] for i, p in enumerate(ground_truth.tolist())]
    low, high = limits(sequence.structure, ground_truth)
    for run in runs:
        p = run.errors.pairs.estimate_m
        inside = np.logical_and(p >= low, p <= high).all(axis=1)
        kept = np.where(inside.reshape(-1, 1), p, np.nan)
        solid.plot(*kept.T, **_path_style(run, kept))
        rows += [[run.name, f, *q] for f, q in zip(run.errors.frames.tolist(), p.tolist(), strict=True) if q[0] == q[0]]
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(solid, f"set_{axis}lim")(a, b)
        getattr(solid, f"set_{axis}label")(f"{axis} (m)", labelpad=-6)
        getattr(solid, f"{axis}axis").pane.fill = False
    solid.tick_params(labelsize=6, pad=-3)
    solid.zaxis.set_major_locator(MaxNLocator(3))
    solid.set_box_aspect(tuple(high - low), zoom=1.12)
    solid.view_init(elev=24, azim=-58)
    columns = ["run", "frame", "x_m", "y_m", "z_m"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(flat, {"ncols": 6}))


def draw_paths_from_above(runs: ListOf[ScoredRun], panel: Axes) -> None:
    """Draw true and estimated paths of runs on one sequence over the structure, from above; in m."""
    sequence = runs[0].sequence
    ground_truth = evaluated_poses(sequence).positions_m
    outline(panel, sequence.structure)
    panel.plot(ground_truth[:, 0], ground_truth[:, 1], color=GROUND_TRUTH, lw=1.6, label="ground truth")
    panel.plot(*ground_truth[0, :2], marker="o", ms=4.5, color=GROUND_TRUTH, mfc="white", ls="none", label="start")
    for run in runs:
        p = run.errors.pairs.estimate_m
        panel.plot(*p[:, :2].T, label=run.title, **_path_style(run, p))
    low, high = limits(sequence.structure, ground_truth)
    panel.set_aspect("equal")
    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")


def _path_style(run: ScoredRun, drawn: Array) -> dict[str, Any]:
    """Line style of a run's path, of which the positions `drawn` (n, 3) are; a cross for one that stays within 1 cm."""
    p, ok = run.errors.pairs.estimate_m, run.errors.ok
    still = float(np.nanmax(np.ptp(p[ok], axis=0))) < 0.01 if ok.any() else True
    return {**line(run.colour), "lw": 0.9, **({"marker": "x"} if still else dots_where_alone(drawn[:, 0]))}


def outline(panel: Axes, structure: Structure) -> None:
    """Draw the structure from above: its upward faces filled, and its edges; in m."""
    up = structure.face_normals[structure.triangle_face][:, 2] > 0.3
    for triangle in structure.triangles[up]:
        panel.fill(*structure.vertices[triangle][:, :2].T, color="#DDD6CB", lw=0.3, zorder=1)
    segments = list(structure.edge_segments[:, :, :2])
    panel.add_collection(LineCollection(segments, colors="#8A7F70", linewidths=0.7, zorder=1.5))


class Corners(NamedTuple):
    """Lowest and highest corner (3,) of a box, in m."""

    low: Array
    high: Array


def limits(structure: Structure, ground_truth: Array) -> Corners:
    """Box around the structure and the true positions (n, 3) with a margin; estimates outside of it are not drawn."""
    low = np.minimum(structure.bounds[0], ground_truth.min(axis=0))
    high = np.maximum(structure.bounds[1], ground_truth.max(axis=0))
    margin = 0.12 * float((high - low).max())
    return Corners(low - [margin, margin, 0.0], high + margin)


def error_against_distance(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_error_against_distance` as files at a stem; their paths."""
    boxed = any(len(_over(run, length)) for run in runs for length in _lengths(runs))
    return save_drawn(partial(draw_error_against_distance, runs), stem, 2.4, wide=boxed)


def draw_error_against_distance(runs: ListOf[ScoredRun], figure: Figure | SubFigure) -> Drawn:
    """(a) Position error against distance travelled; (b) box plots of the relative error over sub-trajectory lengths.

    Without (b) when the frames are so far apart that there is no sub-trajectory of any of the lengths.
    """
    over = {run.name: _over_lengths(run, runs) for run in runs}
    boxed = any(over.values())
    left, *right = figure.subplots(1, 2 if boxed else 1, squeeze=False)[0]
    rows: list[list[Any]] = []
    for run in runs:
        errors, along = run.errors, distance_along(run.errors.pairs.reference_m)
        values = np.where(errors.ok, 100 * errors.translation_m, np.nan)
        left.plot(along, values, label=run.title, **line(run.colour), **dots_where_alone(values))
        rows += [
            [run.name, "along", a, finite(m)]
            for a, m in zip(along.tolist(), errors.translation_m.tolist(), strict=True)
        ]
        for length, values in over[run.name].items():
            rows += [[run.name, f"over {length:.4g} m", None, value] for value in values.tolist()]
    for letter, panel in zip("ab", (left, *right), strict=False):
        logarithmic(panel.yaxis)
        panel_letter(panel, letter if boxed else "")
    for panel in right:
        _draw_boxes(panel, runs, over)
        nice_log(panel)
    nice_log(left)
    left.set_xlabel("distance travelled (m)")
    left.set_ylabel("position error (cm)")
    legend = legend_of(left, {"ncols": 6 if boxed else 3})
    return Drawn(columns=["run", "what", "distance_m", "error_m"], rows=rows, legend=legend)


def _lengths(runs: ListOf[ScoredRun]) -> list[float]:
    """Lengths of the sub-trajectories in m."""
    total = float(distance_along(evaluated_poses(runs[0].sequence).positions_m)[-1])
    return [share * total for share in SHARES]


def _over(run: ScoredRun, length_m: float) -> Array:
    """Relative errors (n,) in m over the sub-trajectories of one length."""
    if length_m <= 0:
        return np.empty(0)
    pairs, ok = run.errors.pairs, run.errors.ok
    i, j = interval_pairs(pairs, PairInterval(length_m, "m", all_pairs=True))
    both = ok[i] & ok[j]
    return relative_errors(pairs, i[both], j[both], "translation_m")


def _over_lengths(run: ScoredRun, runs: ListOf[ScoredRun]) -> dict[float, Array]:
    """Relative errors (n,) in m by length of the sub-trajectories in m, for the lengths that have any."""
    return {length: values for length in _lengths(runs) if len(values := _over(run, length))}


def _draw_boxes(panel: Axes, runs: ListOf[ScoredRun], over: Mapping[str, Mapping[float, Array]]) -> None:
    lengths = sorted({length for of_run in over.values() for length in of_run})
    for k, run in enumerate(runs):
        known = [(lengths.index(length), values) for length, values in over[run.name].items()]
        if not known:
            continue
        ink = {"color": colour(run.colour), "linewidth": 0.8}
        panel.boxplot(
            [100 * values / lengths[place] for place, values in known],
            positions=[place + (k - (len(runs) - 1) / 2) * 0.8 / len(runs) for place, _ in known],
            widths=0.6 / len(runs), manage_ticks=False, showfliers=False, patch_artist=True,
            whis=(5, 95), boxprops={**ink, "facecolor": "white"}, medianprops={**ink, "linewidth": 1.6},
            whiskerprops=ink, capprops=ink,
        )  # fmt: skip
    panel.set_xticks(range(len(lengths)), [f"{length:.2g}" for length in lengths])
    panel.grid(False, axis="x")
    panel.set_xlabel("length of the sub-trajectory (m)")
    panel.set_ylabel("relative error (% of length)")
