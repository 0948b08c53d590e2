"""Figure of a flight in closed loop: true, estimated and planned path, errors, innovations, availability of poses."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]

from uavbench.reports.closed_loop.flown import Flown
from uavbench.reports.closed_loop.measures import tracker_errors
from uavbench.reports.figures.figure_files import Drawn, save_drawn
from uavbench.reports.figures.logarithmic import logarithmic
from uavbench.reports.figures.space import limits
from uavbench.reports.style import GROUND_TRUTH, LOSS, panel_letter
from uavbench.trajectories.pose import Array

ESTIMATED, PLANNED, CRASH, FIX = "#2C458C", "#9EB300", "#E82267", "#9EB300"
TRACKER = "#E82267"
LEAST_CM = 0.01
"""Lower limit of the errors on the logarithmic axis."""


def flight_in_closed_loop(flown: Flown, stem: Path) -> list[Path]:
    """Write `draw_flight_in_closed_loop` as files at a stem; their paths."""
    return save_drawn(partial(draw_flight_in_closed_loop, flown), stem, 3.8)


def draw_flight_in_closed_loop(flown: Flown, figure: Figure | SubFigure) -> Drawn:
    """The flight in 3-D; over time, errors of path, filter and tracker, rejected innovations, and availability."""
    grid = figure.add_gridspec(3, 2, width_ratios=[1.5, 1.0], height_ratios=[1.6, 1.2, 0.7])
    solid: Any = figure.add_subplot(grid[:, 0], projection="3d")
    _draw_space(solid, flown)
    panels = [figure.add_subplot(grid[i, 1]) for i in range(3)]
    t, path = flown.path.seconds, flown.path
    true_m = path.group("true_p_m")
    errors_cm = {
        "path": 100 * np.linalg.norm(true_m - path.group("planned_p_m"), axis=1),
        "estimate": 100 * np.linalg.norm(true_m - path.group("estimated_p_m"), axis=1),
    }
    _draw_errors(panels[0], flown, errors_cm)
    _draw_innovations(panels[1], flown)
    _draw_availability(panels[2], flown)
    for letter, panel in zip("abc", panels, strict=True):
        panel_letter(panel, letter)
        panel.set_xlim(0, float(flown.record["flight"]["planned_s"]))
        panel.tick_params(labelbottom=panel is panels[2])
        if flown.record["flight"]["status"] != "completed":
            panel.axvline(flown.record["flight"]["ended_s"], color=CRASH, lw=0.8)
    panels[2].set_xlabel("time (s)")
    columns = ["t_s", "x_m", "y_m", "z_m", "path_error_cm", "estimate_error_cm"]
    rows = np.column_stack([t, true_m, *errors_cm.values()]).tolist()
    return Drawn(columns=columns, rows=[[None if v != v else v for v in row] for row in rows], legend=None)


def _draw_space(solid: Any, flown: Flown) -> None:
    structure, path = flown.structure, flown.path
    true_m, plan_m = path.group("true_p_m"), flown.plan[:, 1:4]
    low, high = limits(structure, np.vstack([true_m, plan_m]))
    solid.add_collection3d(
        Poly3DCollection(structure.vertices[structure.triangles], facecolor="#DDD6CB", edgecolor="none", alpha=0.35)
    )
    solid.add_collection3d(Line3DCollection(structure.edge_segments, colors="#8A7F70", linewidths=0.5))
    solid.plot(*plan_m.T, color=PLANNED, lw=1.6, label="planned")
    solid.plot(*true_m.T, color=GROUND_TRUTH, lw=1.0, label="true")
    estimated = path.group("estimated_p_m")
    if np.isfinite(estimated).any():
        solid.plot(*_within(estimated, low, high).T, color=ESTIMATED, lw=0.8, ls=(0, (4, 1)), label="estimated")
    fixed = path.group("gnss_fix")[:, 0].astype(bool)
    without = np.where(fixed[:, None], np.nan, true_m)
    if fixed.any() and not fixed.all():
        solid.plot(*without.T, color=LOSS, lw=4.0, alpha=0.7, zorder=0, label="no GNSS fix")
    solid.plot(*true_m[:1].T, marker="o", ms=4.5, color=GROUND_TRUTH, mfc="white", ls="none")
    if flown.record["flight"]["status"] != "completed":
        solid.plot(*true_m[-1:].T, marker="X", ms=6, color=CRASH, ls="none", label=flown.record["flight"]["status"])
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(solid, f"set_{axis}lim")(a, b)
        if axis != "z":
            getattr(solid, f"set_{axis}label")(f"{axis} (m)", labelpad=-6)
        getattr(solid, f"{axis}axis").pane.fill = False
    solid.text(high[0], high[1], high[2] + 0.06 * float((high - low).max()), "z (m)", ha="center")
    solid.tick_params(labelsize=6, pad=-3)
    solid.zaxis.set_major_locator(MaxNLocator(3))  # more would overlap in a flat scene
    solid.set_box_aspect(tuple(high - low), zoom=1.1)
    solid.view_init(elev=22, azim=-62)
    solid.legend(loc="upper left")


def _within(places: Array, low: Array, high: Array) -> Array:
    """Points (n, 3), NaN for those outside the box between two corners (3,)."""
    inside = np.asarray(((places >= low) & (places <= high)).all(axis=1))
    return np.where(inside[:, None], places, np.nan)


def _draw_errors(panel: Axes, flown: Flown, errors_cm: dict[str, Array]) -> None:
    inks = {"path": GROUND_TRUTH, "estimate": ESTIMATED}
    for label, values in errors_cm.items():
        if np.isfinite(values).any():
            panel.plot(flown.path.seconds, np.maximum(values, LEAST_CM), color=inks[label], label=label)
    translation_m, _, _ = tracker_errors(flown)
    at = flown.results.stamps_ns / 1e9
    known = np.isfinite(translation_m)
    if known.any():
        values = np.maximum(100 * translation_m[known], LEAST_CM)
        panel.plot(at[known], values, color=TRACKER, ls="none", marker=".", ms=2, label="tracker")
    logarithmic(panel.yaxis)
    panel.set_ylabel("error (cm)")
    panel.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.02, 0.98), handlelength=1.0, columnspacing=0.8)


def _draw_innovations(panel: Axes, flown: Flown) -> None:
    """Normalized innovations of the camera's poses; rejected ones hollow."""
    told = [row for row in flown.innovations if row[1] == "CameraPose" and row[2] not in (None, "")]
    if told:
        values = np.array([[int(row[0]) / 1e9, float(row[2]) / float(row[3])] for row in told])
        refused = np.array([bool(row[4]) for row in told])
        values[:, 1] = np.clip(values[:, 1], 1e-3, 1e4)
        panel.plot(*values[~refused].T, ls="none", marker=".", ms=2, color=ESTIMATED)
        panel.plot(*values[refused].T, ls="none", marker="o", ms=3, mfc="white", color=CRASH)
    logarithmic(panel.yaxis)
    panel.axhline(1.0, color=LOSS, lw=0.8, zorder=0)
    panel.set_ylabel("innovation")


def _draw_availability(panel: Axes, flown: Flown) -> None:
    """Times with a pose of the tracker, and with a GNSS fix where the flight had one or was denied it."""
    at = np.append(flown.results.stamps_ns / 1e9, flown.record["flight"]["ended_s"])
    ok = flown.results.ok
    for begin, end, good in zip(at[:-1], at[1:], ok, strict=True):
        panel.barh(0, end - begin, left=begin, color=ESTIMATED if good else CRASH, height=0.7, lw=0)
    t = flown.path.seconds
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    fixed = flown.path.group("gnss_fix")[:, 0].astype(bool)
    panel.bar(t[fixed], 0.7, width=step, bottom=0.65, color=FIX, lw=0)
    rows = ["pose", "GNSS"] if fixed.any() or flown.record["loop"]["gnss_outages_s"] else ["pose"]
    panel.set_yticks(range(len(rows)), rows)
    panel.set_ylim(-0.5, len(rows) - 0.5)
    panel.grid(False)
