"""The figure of a trend: the value at every commit, the fitted levels, and the changes."""

from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from uavbench.reports.figures.figure_files import Drawn, finite, save_panel
from uavbench.reports.history.change_points import Change
from uavbench.reports.history.series import LEAST_ERROR, Series
from uavbench.reports.history.trend import Trend, short
from uavbench.reports.style import COLOURS, LOSS, colour, marker
from uavbench.trajectories.pose import Array

TICKS = 6
"""Most commit hashes under a figure 3.50 in wide."""
BAND = 2.0
"""Half the width of the noise band, in standard deviations."""


def draw_trend(trend: Trend, panel: Axes) -> Drawn:
    """Values as dots, the fitted level with a band of BAND sigma of noise, steps as vertical lines, drifts shaded."""
    series = trend.series
    n = len(series.commits)
    at, fitted = np.arange(n), level_of(series, trend.changes)
    spread = BAND * series.noise
    low, high = (
        (fitted - spread, fitted + spread) if series.bigger else (fitted * np.exp(-spread), fitted * np.exp(spread))
    )
    for start, end in pairwise(steps_of(trend.changes, n)):
        part = slice(start, end)
        panel.fill_between(at[part], low[part], high[part], color=LOSS, lw=0, alpha=0.6)
        panel.plot(at[part], fitted[part], color=colour(0), lw=1.0)
    panel.plot(at, series.value, **marker(0), ms=2.4)
    for change in trend.changes:
        bad = change in trend.alarms
        style: dict[str, Any] = {"color": COLOURS[1] if bad else COLOURS[5], "lw": 0.8, "ls": "-" if bad else ":"}
        if change.kind == "drift":
            panel.axvspan(change.first, change.last, color=style["color"], alpha=0.12, lw=0)
        else:
            panel.axvline(change.at - 0.5, **style)
    ticks = np.unique(np.linspace(0, n - 1, min(n, TICKS)).round().astype(int))
    panel.set_xticks(ticks, [short(series.commits[k]) for k in ticks], rotation=30, ha="right")
    panel.set_xlim(-0.7, n - 0.3)
    panel.set_ylabel(f"{series.metric} ({series.unit})" if series.unit else series.metric)
    panel.set_title(series.name, fontsize=7.5)
    rows = [
        [c.commit, c.time, finite(v), finite(lo), finite(hi), finite(level)]
        for c, v, lo, hi, level in zip(
            series.commits, *(x.tolist() for x in (series.value, series.low, series.high, fitted)), strict=True
        )
    ]
    return Drawn(columns=["commit", "time", "value", "low", "high", "level"], rows=rows, legend=None)


def level_of(series: Series, changes: list[Change]) -> Array:
    """The fitted value (n,) at each commit, in the metric's unit: constant between steps, linear along a drift."""
    values = series.value if series.bigger else np.log(np.maximum(series.value, LEAST_ERROR))
    fitted = np.empty(len(values))
    for start, end in pairwise(steps_of(changes, len(values))):
        x = np.arange(start, end)
        line = any(c.kind == "drift" and c.first == start for c in changes)
        fitted[start:end] = np.polyval(np.polyfit(x, values[start:end], int(line)), x)
    return fitted if series.bigger else np.exp(fitted)


def steps_of(changes: list[Change], n: int) -> list[int]:
    """First commits of the levels of n commits, and n."""
    return sorted({0, n, *(change.at for change in changes if change.kind == "step")})


def save_trend(trend: Trend, stem: Path) -> list[Path]:
    """Write `draw_trend` as files at a stem; their paths."""
    return save_panel(partial(draw_trend, trend), stem, 2.1)
