"""Figures of many runs: error over time and distance with bands, spread of the runs, paths, NEES."""

from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import LogLocator

from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn, save_panel
from uavbench.reports.figures.logarithmic import logarithmic, plain_powers
from uavbench.reports.many_runs.comparison import ROUND_OFF, Spread, extra
from uavbench.reports.many_runs.curves import Band
from uavbench.reports.many_runs.evaluate_many import METRICS, EvaluatedRun, ManyRuns
from uavbench.reports.many_runs.groups import counted
from uavbench.reports.style import (
    GROUND_TRUTH,
    MOST_TILTED,
    colour,
    dots_where_alone,
    line,
    marker,
    panel_letter,
    short_names,
)
from uavbench.reports.uncertainty.consistency import DEGREES_OF_FREEDOM
from uavbench.trajectories.pose import Array

WIDE_RANGE = 20.0
"""Ratio of largest to smallest value from which an axis is logarithmic."""
JITTER = 0.3
"""Half the width over which the dots of one tracker are spread, as a fraction of the distance between trackers."""
SHORT_NAMES = 9
"""Total characters of tracker names that fit side by side under a panel of 1.6 in."""


def errors_along(many: ManyRuns, stem: Path) -> list[Path]:
    """Write `draw_errors_along` as files at a stem; their paths."""
    return save_drawn(partial(draw_errors_along, many), stem, 3.6)


def draw_errors_along(many: ManyRuns, figure: Figure | SubFigure) -> Drawn:
    """Position (cm) and rotation (deg) error over time and over distance: median over runs, and a band of 90 %."""
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    rows: list[list[Any]] = []
    axes = (("time", many.time, "time (s)"), ("distance", many.distance, "distance travelled (m)"))
    for column, (along, axis, label) in enumerate(axes):
        for row, (quantity, scale, unit) in enumerate((("position", 100.0, "cm"), ("rotation", 1.0, "deg"))):
            panel = panels[row, column]
            for k, (name, group) in enumerate(many.groups.items()):
                band = Band.of([scale * getattr(run, f"over_{along}")[quantity] for run in group])
                text = as_label(f"{name} ({counted(len(group))})")
                panel.plot(axis.middles, band.middle, label=text, **line(k), **dots_where_alone(band.middle))
                if len(group) > 1:
                    panel.fill_between(axis.middles, band.low, band.high, color=colour(k), alpha=0.15, lw=0)
                values = zip(*(v.tolist() for v in (axis.middles, band.low, band.middle, band.high)), strict=True)
                rows += [[name, along, f"{quantity}_{unit}", x, *map(finite, v)] for x, *v in values]
            panel_letter(panel, "abcd"[2 * row + column])
            if column == 0:
                panel.set_ylabel(f"{quantity} error ({unit})")
            if row == 1:
                panel.set_xlabel(label)
    for pair in panels:
        fit_scale(pair[0], np.concatenate([curve.get_ydata() for panel in pair for curve in panel.lines]))
    columns = ["tracker", "along", "quantity", "at", "low", "median", "high"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(panels[0, 0], {"ncols": min(len(many.groups), 5)}))


def spread(many: ManyRuns, stem: Path) -> list[Path]:
    """Write `draw_spread` as files at a stem; their paths."""
    return save_drawn(partial(draw_spread, many), stem, 2.3)


def draw_spread(many: ManyRuns, figure: Figure | SubFigure) -> Drawn:
    """Errors of every run as dots, by tracker, with their mean and its 95 % interval."""
    known = [metric for metric in METRICS if any(np.isfinite(v).any() for v in many.values(metric).values())]
    panels = figure.subplots(1, len(known), squeeze=False)[0]
    rows: list[list[Any]] = []
    for letter, panel, metric in zip("abcd", panels, known, strict=False):
        about, values = METRICS[metric], many.values(metric)
        for k, (name, of_group) in enumerate(values.items()):
            shown = about.scale * of_group
            dots(panel, k, shown, k)
            mean_bar(panel, k, shown, k)
            names = [run.run.name for run in many.groups[name]]
            rows += [[metric, name, run, finite(v)] for run, v in zip(names, shown.tolist(), strict=True)]
        fit_scale(panel, about.scale * np.concatenate(list(values.values())))
        name_trackers(panel, list(values))
        panel.set_title(f"({letter}) {about.name} ({about.unit})", loc="left", fontsize=7.5)
    return Drawn(columns=["metric", "tracker", "run", "value"], rows=rows, legend=None)


def paths(many: ManyRuns, stem: Path) -> list[Path]:
    """Write `draw_paths` as files at a stem; their paths."""
    return save_panel(partial(draw_paths, many), stem, 3.0)


def draw_paths(many: ManyRuns, panel: Axes) -> Drawn:
    """True path, and the aligned path of the run of median position error of each tracker, from above."""
    rows: list[list[Any]] = [["truth", "", *p] for p in many.truth_path_m.tolist()]
    panel.plot(*many.truth_path_m[:, :2].T, color=GROUND_TRUTH, lw=1.4, label="ground truth")
    for k, (name, group) in enumerate(many.groups.items()):
        run = middle_run(group)
        look = {**line(k), "lw": 0.8, **dots_where_alone(run.path_m[:, 0])}
        which = f"run {run.run.name}" if run.run.name.isdigit() else run.run.name
        panel.plot(*run.path_m[:, :2].T, label=as_label(f"{name}: {which}"), **look)
        rows += [[name, run.run.name, *p] for p in run.path_m.tolist() if p[0] == p[0]]
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")
    return Drawn(columns=["tracker", "run", "x_m", "y_m", "z_m"], rows=rows)


def nees(many: ManyRuns, stem: Path) -> list[Path]:
    """Write `draw_nees` as files at a stem; their paths."""
    return save_panel(partial(draw_nees, many), stem, 2.2)


def draw_nees(many: ManyRuns, panel: Axes) -> Drawn:
    """Mean NEES of every run that claims covariances: as claimed (hollow), and after alignment (filled)."""
    aligned = many.runs[0].record["align"] != "none"
    groups = {
        name: group for name, group in many.groups.items() if any(np.isfinite(extra(run, "nees")) for run in group)
    }
    rows: list[list[Any]] = []
    for k, (name, group) in enumerate(groups.items()):
        index = list(many.groups).index(name)
        sides = (("nees", -0.2, True), ("nees_aligned", 0.2, False)) if aligned else (("nees", 0.0, True),)
        for key, beside, hollow in sides:
            values = np.array([extra(run, key) for run in group])
            dots(panel, k + beside, values, index, hollow=hollow, width=0.15 if aligned else JITTER)
            rows += [[name, run.run.name, key, finite(v)] for run, v in zip(group, values.tolist(), strict=True)]
    panel.axhline(DEGREES_OF_FREEDOM, color=GROUND_TRUTH, lw=0.7, ls=":")
    every = np.array([row[3] for row in rows if row[3] is not None])
    fit_scale(panel, np.append(every, DEGREES_OF_FREEDOM))
    name_trackers(panel, list(groups))
    panel.set_ylabel("mean NEES of a run")
    said = "hollow: as claimed, filled: after alignment" if aligned else "as claimed, without alignment"
    panel.set_title(f"{said}; dotted: {DEGREES_OF_FREEDOM}, expected", fontsize=7.5)
    return Drawn(columns=["tracker", "run", "what", "mean_nees"], rows=rows, legend=None)


def as_label(name: str) -> str:
    """A name as a legend label: matplotlib hides those that begin with `_`."""
    return f" {name}" if name.startswith("_") else name


def middle_run(group: ListOf[EvaluatedRun]) -> EvaluatedRun:
    """The run with the position error nearest to the median of the group."""
    errors = np.array([run.value("ate_position") for run in group])
    return group[int(np.argmin(np.abs(errors - np.median(errors))))]


def dots(panel: Axes, at: float, values: Array, index: int, *, hollow: bool = False, width: float = JITTER) -> None:
    """Draw the values (n,) of a tracker's runs as dots around a place on the x axis, in order from left to right."""
    x = at + width * np.linspace(-1, 1, len(values)) if len(values) > 1 else np.array([at])
    face: dict[str, Any] = {"mfc": "white"} if hollow else {}
    panel.plot(x, values, **marker(index), ms=2.6, mew=0.6, alpha=0.75, **face)


def mean_bar(panel: Axes, at: float, values: Array, index: int) -> None:
    """Draw the mean of a tracker's values (n,), and its interval; nothing for a single run."""
    found = Spread.of(values)
    if found is None or found.std is None:
        return
    panel.plot([at - 0.42, at + 0.42], [found.mean.mean] * 2, color=colour(index), lw=1.4)
    if not found.mean.why:
        low, high = found.mean.low, found.mean.high
        panel.fill_between([at - 0.42, at + 0.42], [low] * 2, [high] * 2, color=colour(index), alpha=0.22, lw=0)


def name_trackers(panel: Axes, names: ListOf[str]) -> None:
    """Label the x axis with the names of the trackers."""
    tilted = len(names) > 3 or max(map(len, names), default=0) > SHORT_NAMES
    turned = 90 if len(names) > MOST_TILTED else 35 if tilted else 0
    panel.set_xticks(range(len(names)), short_names(names), rotation=turned, ha="right" if turned == 35 else "center")
    panel.set_xlim(-0.6, len(names) - 0.4)
    panel.grid(False, axis="x")


def fit_scale(panel: Axes, values: Array) -> None:
    """Scale the y axis from zero, or logarithmically when values (n,) range over a factor of more than WIDE_RANGE.

    On a logarithmic axis zeros and round-off lie at its lower end.
    """
    known = values[np.isfinite(values) & (values > 0)]
    known = known[known > ROUND_OFF * known.max(initial=0.0)]
    if len(known) and known.max() > WIDE_RANGE * known.min():
        logarithmic(panel.yaxis)
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        plain_powers(panel.yaxis)
        if (values < known.min()).any():
            panel.set_ylim(float(known.min()) / 2, 1.5 * float(known.max()))
            _lift(panel, float(known.min()) / 2)
    else:
        panel.set_ylim(0, max(panel.get_ylim()[1], 1.05 * float(known.max())) if len(known) else None)


def _lift(panel: Axes, least: float) -> None:
    """Draw what lies below a value at it, on all axes that share this y axis."""
    for axes in panel.get_shared_y_axes().get_siblings(panel):
        for curve in axes.lines:
            curve.set_ydata(np.maximum(curve.get_ydata(), least))
