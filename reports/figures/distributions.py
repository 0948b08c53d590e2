"""Figures of statistics: attributes, NEES, error over the Cramer-Rao bound, sweeps."""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from uavbench.reports.figures.figure_files import Drawn, finite, legend_of, save_drawn, save_panel
from uavbench.reports.figures.logarithmic import logarithmic
from uavbench.reports.scoring.attributes import ATTRIBUTES, Part
from uavbench.reports.scoring.runs import ScoredRun
from uavbench.reports.statistics.bootstrap import hierarchical_interval
from uavbench.reports.style import GROUND_TRUTH, colour, dots_where_alone, line, marker, panel_letter
from uavbench.reports.uncertainty.consistency import DEGREES_OF_FREEDOM, chi_square_quantile
from uavbench.reports.uncertainty.nees import nees
from uavbench.trajectories.pose import Array

LEAST_NEES = 0.01
"""Lower end of the axis of NEES, for the run of the least median in medians if that is below 1."""


def by_attribute(found: Mapping[str, Mapping[str, ListOf[Part]]], colours: Mapping[str, int], stem: Path) -> list[Path]:
    """Write `draw_by_attribute` as files at a stem; their paths."""
    return save_drawn(partial(draw_by_attribute, found, colours), stem, 1.9)


def draw_by_attribute(
    found: Mapping[str, Mapping[str, ListOf[Part]]], colours: Mapping[str, int], figure: Figure | SubFigure
) -> Drawn:
    """Success of each run in quartiles of each frame attribute.

    found: parts by attribute and run, as `breakdowns` returns them; colours: index of a colour by run.
    """
    panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    rows: list[list[Any]] = []
    for letter, panel, (attribute, runs) in zip("abcdefgh", panels, found.items(), strict=False):
        unit = ATTRIBUTES[attribute][0]
        for name, parts in runs.items():
            middles = [(part.low + part.high) / 2 for part in parts]
            shares = [100 * part.success for part in parts]
            index = colours.get(name, 0)
            panel.plot(middles, shares, **{**line(index), "marker": marker(index)["marker"]}, label=name)
            rows += [[attribute, name, p.low, p.high, p.frames, p.success, finite(p.median_m)] for p in parts]
        panel.set_xlabel(f"{attribute} ({unit})" if unit else attribute)
        panel.set_ylim(-4, 104)
        panel_letter(panel, letter)
    panels[0].set_ylabel("within 5 cm, 5 deg (%)")
    columns = ["attribute", "run", "low", "high", "frames", "success", "median_error_m"]
    return Drawn(columns=columns, rows=rows, legend=legend_of(panels[0], {"ncols": 6}))


def nees_over_time(runs: ListOf[ScoredRun], stem: Path) -> list[Path]:
    """Write `draw_nees_over_time` as files at a stem; their paths."""
    return save_panel(partial(draw_nees_over_time, runs), stem, 2.0)


def draw_nees_over_time(runs: ListOf[ScoredRun], panel: Axes) -> Drawn:
    """NEES over time of every run that claims covariances, with the central 95 % of chi-square (6 dof)."""
    low, high = (chi_square_quantile(p, DEGREES_OF_FREEDOM) for p in (0.025, 0.975))
    panel.axhspan(low, high, color="#E8E8E8", lw=0, label="95 % of a consistent tracker")
    panel.axhline(DEGREES_OF_FREEDOM, color=GROUND_TRUTH, lw=0.7, ls=":")
    rows: list[list[Any]] = []
    usual: list[float] = []
    fastest_hz = max((run.score.rate_hz for run in runs), default=0.0)
    for run in runs:
        values = nees(run.sequence, run.results)
        values = np.where(np.isfinite(values), values, np.nan)
        if np.isnan(values).all():
            continue
        t = (run.results.stamps_ns - run.sequence.stamps_ns[0]) / 1e9
        look = line(run.colour, slower=run.score.rate_hz < fastest_hz)
        panel.plot(t, values, label=run.title, **look, **dots_where_alone(values))
        usual += [median] if (median := float(np.nanmedian(values))) > 0 else []
        rows += [[run.name, s, finite(v)] for s, v in zip(t.tolist(), values.tolist(), strict=True)]
    logarithmic(panel.yaxis)
    if usual:  # the given pose of a first frame has round-off for an error
        panel.set_ylim(bottom=max(panel.get_ylim()[0], min(LEAST_NEES, LEAST_NEES * min(usual))))
    panel.set_xlabel("time (s)")
    panel.set_ylabel("NEES")
    return Drawn(columns=["run", "time_s", "nees"], rows=rows, legend={"ncols": 3})


def error_over_bound(ratios: Mapping[str, Array], colours: Mapping[str, int], stem: Path) -> list[Path]:
    """Write `draw_error_over_bound` as files at a stem; their paths."""
    return save_panel(partial(draw_error_over_bound, ratios, colours), stem, 2.1)


def draw_error_over_bound(ratios: Mapping[str, Array], colours: Mapping[str, int], panel: Axes) -> Drawn:
    """Cumulative distribution of the ratio of position error to Cramer-Rao bound (1: efficient) of each run.

    ratios (n,) by run, infinite for lost frames; colours: index of a colour by run.
    """
    rows: list[list[Any]] = []
    for name, values in ratios.items():
        known = np.sort(values[np.isfinite(values)])
        share = 100 * np.arange(1, len(known) + 1) / len(values)
        starts = [0.0] * len(known[:1])  # none where no ratio is known
        panel.plot(
            [*known[:1], *known],
            [*starts, *share],
            drawstyle="steps-post",
            label=f"{name}: {_median(values)}",
            **line(colours.get(name, 0)),
        )
        rows += [[name, ratio, s / 100] for ratio, s in zip(known.tolist(), share.tolist(), strict=True)]
    panel.axvline(1, color=GROUND_TRUTH, lw=0.7, ls=":")
    logarithmic(panel.xaxis)
    panel.set_xlim(left=max(panel.get_xlim()[0], 0.02))
    panel.set_ylim(0, 102)
    panel.set_xlabel("position error / Cramer-Rao bound")
    panel.set_ylabel("frames below it (%)")
    return Drawn(columns=["run", "ratio", "share_of_frames"], rows=rows, legend={"ncols": 2})


def draw_sweep(
    curves: Mapping[str, Mapping[float, ListOf[Array]]],
    colours: Mapping[str, int],
    panel: Axes,
    *,
    swept: str,
    metric: str,
    share: bool = False,
) -> Drawn:
    """A metric against a swept parameter (noise, speed, deviation), with the 95 % interval as a band.

    curves[tracker][value]: the metric as an array over the seeds of each sequence; share: percentages, otherwise errors
    on a logarithmic axis. The parameter's axis is logarithmic when it spans more than a decade.
    """
    rows: list[list[Any]] = []
    for name, points in curves.items():
        xs = sorted(points)
        found = [hierarchical_interval(points[x]) for x in xs]
        index = colours.get(name, 0)
        bounds = np.clip([[f.low, f.high] for f in found], 0.0, 100.0 if share else np.inf)
        panel.fill_between(xs, *bounds.T, color=colour(index), alpha=0.2, lw=0)
        panel.plot(xs, [f.mean for f in found], label=name, **{**line(index), "marker": marker(index)["marker"]})
        rows += [
            [name, x, f.mean, finite(low), finite(high), f.n, f.why]
            for x, f, (low, high) in zip(xs, found, bounds.tolist(), strict=True)
        ]
    values = [row[1] for row in rows]
    if values and min(values) > 0 and max(values) > 10 * min(values):
        logarithmic(panel.xaxis)
    if share:
        panel.set_ylim(-3, 103)
    else:
        logarithmic(panel.yaxis)
        panel.set_ylim(bottom=0.5 * min((row[2] for row in rows if row[2] > 0), default=1e-3))
    panel.set_xlabel(swept)
    panel.set_ylabel(metric)
    columns = ["tracker", "value", "mean", "low", "high", "runs", "no_interval"]
    return Drawn(columns=columns, rows=rows, legend={"ncols": 4})


def _median(values: Array) -> str:
    middle = float(np.median(values))
    return f"median {middle:.1f}" if np.isfinite(middle) else "over half lost"
