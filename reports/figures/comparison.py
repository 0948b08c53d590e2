"""Figures that compare trackers: error beside coverage, success curves, accuracy against latency."""

from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FuncFormatter

from uavbench.reports.figures.drawn import Drawn, save_drawn, save_panel
from uavbench.reports.figures.logarithmic import logarithmic, plain_powers
from uavbench.reports.metrics.frame_errors import SUCCESS_M
from uavbench.reports.scoring.coverage import AUC_LIMIT_M, success_auc, success_curve
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.style import GROUND_TRUTH, colour, line, marker

HATCHES = ("", "////", "....", "xxxx")


def accuracy_and_coverage(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_accuracy_and_coverage` as files at a stem; their paths."""
    return save_drawn(partial(draw_accuracy_and_coverage, runs), stem, 2.1)


def draw_accuracy_and_coverage(runs: ListOf[ScoredRun], figure: Figure | SubFigure) -> Drawn:
    """ATE of position and rotation, coverage and success of every tracker at every rate, in four panels."""
    labels = list(dict.fromkeys(run.score.label for run in runs))
    rates = sorted({run.score.rate_hz for run in runs}, reverse=True)
    panels = figure.subplots(1, 4)
    names = ("ATE position (cm)", "ATE rotation (deg)", "coverage (%)", "within 5 cm and 5 deg (%)")
    rows = []
    width = 0.8 / len(rates)
    for k, label in enumerate(labels):
        for r, rate in enumerate(rates):
            group = [run for run in runs if (run.score.label, run.score.rate_hz) == (label, rate)]
            values = [mean_of(group, index) for index in range(4)]
            rows.append([label, rate, len(group), *values])
            x = k + (r - (len(rates) - 1) / 2) * width
            for panel, value in zip(panels, values, strict=True):
                if value is None:
                    panel.annotate(
                        "none", (x, 0.03), xycoords=("data", "axes fraction"), rotation=90, ha="center", fontsize=6
                    )
                    continue
                panel.bar(x, value, 0.9 * width, color=colour(group[0].colour), alpha=1 if r == 0 else 0.55,
                          hatch=HATCHES[r % 4], edgecolor="white", lw=0)  # fmt: skip
    for letter, panel, name in zip("abcd", panels, names, strict=True):
        panel.set_xticks(range(len(labels)), labels, rotation=35 if len(labels) > 4 else 0)
        panel.grid(False, axis="x")
        panel.set_title(f"({letter}) {name}", loc="left", fontsize=7.5)
    for panel in panels[:2]:
        logarithmic(panel.yaxis)
        low, high = panel.get_ylim()
        bottom = 10 ** np.floor(np.log10(low))
        panel.set_ylim(bottom, max(high, 10 * bottom))
        plain_powers(panel.yaxis)
    panels[0].axhline(100 * SUCCESS_M, color=GROUND_TRUTH, lw=0.6, ls=":")
    panels[1].axhline(5, color=GROUND_TRUTH, lw=0.6, ls=":")
    for panel in panels[2:]:
        panel.set_ylim(0, 105)
    swatches = [
        panels[0].bar(0, 0, color="#777777", alpha=1 if r == 0 else 0.55, hatch=HATCHES[r % 4], edgecolor="white", lw=0)
        for r in range(len(rates))
    ]
    figure.legend(swatches, [f"{rate:g} Hz" for rate in rates], loc="outside lower center", ncols=4)
    columns = [
        "tracker",
        "rate_hz",
        "runs",
        "ate_position_cm",
        "ate_rotation_deg",
        "coverage_percent",
        "success_percent",
    ]
    return Drawn(columns=columns, rows=rows, legend=None)


def mean_of(group: ListOf[ScoredRun], index: int) -> float | None:
    """Mean over runs of ATE position (cm), ATE rotation (deg), coverage (%) or success (%); None without a value."""
    values = []
    for run in group:
        ate, tracking = run.score.ate["none"], run.score.tracking
        values.append([
            100 * ate.translation_m.rmse if ate.translation_m else None,
            ate.rotation_deg.rmse if ate.rotation_deg else None,
            100 * tracking.coverage,
            100 * tracking.success,
        ][index])  # fmt: skip
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None


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
