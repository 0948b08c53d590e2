"""Figures over the flights of a suite: success of each run, and success and path error along a swept parameter."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uavbench.reports.closed_loop.comparison import by_run, flown_of, success
from uavbench.reports.closed_loop.measures import FlightScore
from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn
from uavbench.reports.figures.logarithmic import logarithmic
from uavbench.reports.figures.sweeps import LEAST_VALUES, leaves
from uavbench.reports.style import colour, line, marker, panel_letter, short_names

STATUS_COLOUR = {"completed": "#9EB300", "crashed": "#E82267", "strayed": "#67001C", "timed out": "#735F0C"}
"""Colours of failed flights by status; one that left its corridor is `completed`."""
ESTIMATOR = "estimator"
"""Key of `[loop]` that may differ beside a swept number: a curve for each."""
LEAST_CM = 0.1
"""Lower limit of the path errors on the logarithmic axis."""


@dataclass(frozen=True)
class SweptLoops:
    """The only number in which the loops of a suite differ, beside the estimator.

    key: dotted; values, estimators: by name of the loop; the latter are empty where all loops have the same.
    """

    key: str
    values: Mapping[str, float]
    estimators: Mapping[str, str]


def swept_loops(tables: Mapping[str, Mapping[str, Any]]) -> SweptLoops | None:
    """The parameter that the `[loop]` tables of a suite sweep, given by name, for one estimator or for each.

    None unless they differ in exactly one number, with LEAST_VALUES values or more, and at most in the estimator.
    """
    configs = {name: dict(leaves(table)) for name, table in tables.items()}
    keys = {key for config in configs.values() for key in config}
    differing = {key for key in keys if len({repr(config.get(key)) for config in configs.values()}) > 1}
    estimators = {name: str(config[ESTIMATOR]) if ESTIMATOR in differing else "" for name, config in configs.items()}
    if len(differing - {ESTIMATOR}) != 1:
        return None
    (key,) = differing - {ESTIMATOR}
    values = {name: config.get(key) for name, config in configs.items()}
    numbers = {name: float(v) for name, v in values.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    if len(numbers) < len(configs) or len(set(numbers.values())) < LEAST_VALUES:
        return None
    return SweptLoops(key, numbers, estimators)


def success_of_runs(scores: ListOf[FlightScore], stem: Path) -> list[Path]:
    """Write `draw_success_of_runs` as files at a stem; their paths."""
    return save_drawn(partial(draw_success_of_runs, scores), stem, 0.9 + 0.24 * len(by_run(scores)))


def draw_success_of_runs(scores: ListOf[FlightScore], figure: Figure | SubFigure) -> Drawn:
    """(a) Success rate of each run with its Wilson interval; (b) greatest path error of each flight, by status."""
    groups = by_run(scores)
    left, right = figure.subplots(1, 2, sharey=True)
    rows: list[list[Any]] = []
    for place, (run, group) in enumerate(groups.items()):
        share, group = success(group), flown_of(group)
        left.plot([100 * share.low, 100 * share.high], [place, place], color=colour(0), lw=1.4)
        left.plot(100 * share.share, place, **marker(0))
        for score in group:
            error_cm = max(100 * score.path_max_m, LEAST_CM)
            ink = colour(0) if score.success else STATUS_COLOUR.get(score.status, "#67001C")
            label = "success" if score.success else "left its corridor" if score.status == "completed" else score.status
            right.plot(error_cm, place, ls="none", marker="o" if score.success else "X", ms=3.5, color=ink, label=label)
        rows.append(
            [run, share.n, share.successes, share.low, share.high, max((s.path_max_m for s in group), default=None)]
        )
    left.set_yticks(range(len(groups)), short_names(list(groups)))
    left.set_ylim(len(groups) - 0.5, -0.5)
    left.set_xlim(-3, 103)
    left.set_xlabel("success, 95 % interval (%)")
    logarithmic(right.xaxis)
    right.set_xlabel("greatest path error (cm)")
    panel_letter(left, "a")
    panel_letter(right, "b")
    columns = ["run", "flights", "successes", "low", "high", "path_max_m"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(right, {"ncols": 5}))


def along_loops(scores: ListOf[FlightScore], found: SweptLoops, stem: Path) -> list[Path]:
    """Write `draw_along_loops` as files at a stem; their paths."""
    return save_drawn(partial(draw_along_loops, scores, found), stem, 2.5)


def draw_along_loops(scores: ListOf[FlightScore], found: SweptLoops, figure: Figure | SubFigure) -> Drawn:
    """(a) Success with its Wilson interval and (b) rms path error, mean and range, over the swept parameter."""
    left, right = figure.subplots(1, 2)
    rows: list[list[Any]] = []
    for index, (name, points) in enumerate(_curves(scores, found).items()):
        xs = sorted(points)
        shares = [success(points[x]) for x in xs]
        errors_cm = [np.array([100 * s.path_rms_m for s in flown_of(points[x])] or [np.nan]) for x in xs]
        look = {**line(index), "marker": marker(index)["marker"], "label": name}
        bounds = 100 * np.array([[s.low, s.high] for s in shares])
        left.fill_between(xs, *bounds.T, color=colour(index), alpha=0.15, lw=0)
        left.plot(xs, [100 * s.share for s in shares], **look)
        right.fill_between(
            xs, [e.min() for e in errors_cm], [e.max() for e in errors_cm], color=colour(index), alpha=0.15, lw=0
        )
        right.plot(xs, [e.mean() for e in errors_cm], **look)
        rows += [
            [name, x, s.n, s.successes, s.low, s.high, finite(float(e.mean()))]
            for x, s, e in zip(xs, shares, errors_cm, strict=True)
        ]
    _axes(left, found.key, "success (%)", "a")
    _axes(right, found.key, "rms path error (cm)", "b")
    left.set_ylim(-3, 103)
    logarithmic(right.yaxis)
    columns = ["run", found.key, "flights", "successes", "low", "high", "path_rms_cm"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(left, {"ncols": 6}))


def _curves(scores: ListOf[FlightScore], found: SweptLoops) -> dict[str, dict[float, list[FlightScore]]]:
    """Scores by tracker, rate and estimator, then by value of the swept parameter."""
    curves: dict[str, dict[float, list[FlightScore]]] = {}
    for score in scores:
        name, _, variant = score.run.partition("+")
        name = " ".join(filter(None, (name, found.estimators[variant])))
        curves.setdefault(name, {}).setdefault(found.values[variant], []).append(score)
    return curves


def _axes(panel: Axes, key: str, metric: str, letter: str) -> None:
    panel.set_xlabel(key)
    panel.set_ylabel(metric)
    panel_letter(panel, letter)
