"""Figures that compare trackers: error and coverage, success curves, accuracy against latency."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from uavbench.reports.figures.figure_files import Drawn, save_drawn, save_panel
from uavbench.reports.figures.logarithmic import logarithmic, plain_powers
from uavbench.reports.metrics.frame_errors import SUCCESS_DEG, SUCCESS_M
from uavbench.reports.scoring.coverage import AUC_LIMIT_M, success_auc, success_curve
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.style import GROUND_TRUTH, MOST_TILTED, colour, line, marker, short_names

FILLS: tuple[Any, ...] = ("full", "none", "left", "bottom")
"""Fill styles of the markers of rates, the highest first."""
LEAST_SHOWN = 1e-3
"""Least ATE on a logarithmic axis, in cm and deg: of an initial pose alone it is 0 or round-off, and is drawn here."""
SIDE_BY_SIDE = 32
"""Total characters of tracker names that fit side by side under a quarter of 7.16 in."""


def accuracy_and_coverage(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_accuracy_and_coverage` as files at a stem; their paths."""
    return save_drawn(partial(draw_accuracy_and_coverage, runs), stem, 2.1)


def draw_accuracy_and_coverage(runs: ListOf[ScoredRun], figure: Figure | SubFigure) -> Drawn:
    """ATE of position and rotation, coverage and success of every tracker at every rate: every run, and the mean."""
    labels = list(dict.fromkeys(run.score.label for run in runs))
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    panels = figure.subplots(1, 4)
    names = ("ATE position (cm)", "ATE rotation (deg)", "coverage (%)", "within 5 cm and 5 deg (%)")
    rows = []
    for k, label in enumerate(labels):
        for r, rate in enumerate(rates):
            group = [run for run in runs if (run.score.label, run.score.rate_hz) == (label, rate)]
            x = k + 0.8 * ((r + 0.5) / len(rates) - 0.5)
            means = [
                _draw_runs(panel, x, values_of(group, i), FILLS[r % 4], group, least=LEAST_SHOWN if i < 2 else 0.0)
                for i, panel in enumerate(panels)
            ]
            rows.append([label, rate, len(group), *means])
    ticks = short_names(labels)
    long = len("".join(ticks)) > SIDE_BY_SIDE
    turned = 90 if len(labels) > MOST_TILTED else 35 if long or len(labels) > 4 else 0
    for letter, panel, name in zip("abcd", panels, names, strict=True):
        panel.set_xticks(range(len(labels)), ticks, rotation=turned, ha="right" if long and turned == 35 else "center")
        panel.set_xlim(-0.5, len(labels) - 0.5)
        panel.grid(False, axis="x")
        panel.set_title(f"({letter}) {name}", loc="left", fontsize=7.5)
    for panel, success in zip(panels[:2], (100 * SUCCESS_M, SUCCESS_DEG), strict=True):
        logarithmic(panel.yaxis)
        low, high = panel.get_ylim()
        panel.set_ylim(10 ** np.floor(np.log10(low)), 10 ** np.ceil(np.log10(high)))
        plain_powers(panel.yaxis)
        panel.axhline(success, color=GROUND_TRUTH, lw=0.6, ls=":")
    for panel in panels[2:]:
        panel.set_ylim(-3, 105)
    grey: dict[str, Any] = {"color": "#777777", "linestyle": "none"}
    shown = [Line2D([], [], marker="o", ms=4, fillstyle=FILLS[r % 4], **grey) for r in range(len(rates))]
    shown.append(Line2D([], [], marker=".", ms=3, alpha=0.5, mew=0, **grey))
    texts = [*(f"mean at {rate:g} Hz" for rate in rates), "each run"]
    legend = {"handles": shown, "labels": texts, "loc": "outside lower center", "ncols": 5}
    columns = [
        "tracker",
        "rate_hz",
        "runs",
        "ate_position_cm",
        "ate_rotation_deg",
        "coverage_percent",
        "success_percent",
    ]
    return Drawn(columns=columns, rows=rows, legend=legend)


def _draw_runs(
    panel: Axes, x: float, values: Mapping[str, list[float]], fill: Any, group: ListOf[ScoredRun], *, least: float
) -> float | None:
    """Draw the values of runs by flight, at `least` or above, and their mean, which is returned; None without a value.

    It is that of tables: over flights, of the means over seeds.
    """
    if not values:
        panel.annotate("none", (x, 0.03), xycoords=("data", "axes fraction"), rotation=90, ha="center", fontsize=6)
        return None
    shown, mean = marker(group[0].colour), float(np.mean([np.mean(of_flight) for of_flight in values.values()]))
    every = [value for of_flight in values.values() for value in of_flight]
    if len(every) > 1:
        panel.plot([x] * len(every), np.maximum(every, least), ".", color=shown["color"], ms=3, mew=0, alpha=0.5)
    panel.plot(x, max(mean, least), fillstyle=fill, markerfacecoloralt="white", ms=4, **shown)
    return mean


def values_of(group: ListOf[ScoredRun], index: int) -> dict[str, list[float]]:
    """ATE of position (cm), of rotation (deg), coverage (%) or success (%) of the runs that have one, by flight."""
    values: dict[str, list[float]] = {}
    for run in group:
        ate, tracking = run.score.ate["none"], run.score.tracking
        value = [
            100 * ate.translation_m.rmse if ate.translation_m else None,
            ate.rotation_deg.rmse if ate.rotation_deg else None,
            100 * tracking.coverage,
            100 * tracking.success,
        ][index]
        if value is not None:
            values.setdefault(run.score.flight, []).append(value)
    return values


def success_curves(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_success_curves` as files at a stem; their paths."""
    return save_panel(partial(draw_success_curves, runs), stem, 2.6)


def draw_success_curves(runs: ListOf[ScoredRun], panel: Axes) -> Drawn:
    """Share of all frames within a distance of the ground truth, with the area under each curve up to 10 cm."""
    limits = np.linspace(0, AUC_LIMIT_M, 201)
    curves = []
    for run_name in dict.fromkeys(run.name for run in runs):
        group = [run for run in runs if run.name == run_name]
        errors = np.concatenate([run.errors.translation_m for run in group])
        curve = success_curve(errors, limits)
        curves.append((run_name, curve))
        style = line(group[0].colour, slower=group[0].score.rate_hz < max(run.score.rate_hz for run in runs))
        label = f"{group[0].title}: {success_auc(errors):.2f}"
        panel.plot(100 * limits, 100 * curve, label=label, **style)
    panel.axvline(100 * SUCCESS_M, color=GROUND_TRUTH, lw=0.6, ls=":")
    panel.set_xlim(0, 100 * AUC_LIMIT_M)
    panel.set_ylim(0, 102)
    panel.set_xlabel("position error threshold (cm)")
    panel.set_ylabel("frames within it (%)")
    columns = ["threshold_m", *(name for name, _ in curves)]
    table = np.column_stack([limits, *(curve for _, curve in curves)]).tolist()
    return Drawn(columns=columns, rows=table, legend={"title": "area under the curve", "title_fontsize": 7})


def accuracy_against_latency(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_accuracy_against_latency` as files at a stem; their paths."""
    return save_panel(partial(draw_accuracy_against_latency, runs), stem, 2.2)


def draw_accuracy_against_latency(runs: ListOf[ScoredRun], panel: Axes) -> Drawn:
    """Success against the median time per frame in ms, with a line to its 95th percentile."""
    rows = []
    for run in runs:
        latency, success = run.score.latency.get("total"), run.score.tracking.success
        if latency is None:
            continue
        hollow: dict[str, Any] = {} if run.score.rate_hz == max(r.score.rate_hz for r in runs) else {"mfc": "white"}
        panel.plot([latency.p50_ms, latency.p95_ms], [100 * success] * 2, color=colour(run.colour), lw=0.8)
        panel.plot(latency.p50_ms, 100 * success, label=run.title, **marker(run.colour), **hollow, ms=5)
        rows.append(
            [run.name, run.sequence.name, latency.p50_ms, latency.p95_ms, latency.p99_ms, latency.max_ms, success]
        )
    logarithmic(panel.xaxis)
    panel.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    panel.set_ylim(-3, 103)
    panel.set_xlabel("time per frame (ms): median, line to 95th percentile")
    panel.set_ylabel("frames within 5 cm, 5 deg (%)")
    return Drawn(columns=["run", "sequence", "p50_ms", "p95_ms", "p99_ms", "max_ms", "success"], rows=rows)
