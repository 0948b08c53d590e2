"""Common parts of figures: the result of a drawing function, and functions that write its files."""

from collections.abc import Callable, Iterable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uavbench.reports.style import legend_columns, new_figure, save_figure

LEGEND_ROWS, LEGEND_ROW_IN = 5, 0.16
"""Rows of a legend for which the height of a figure has room, and the height in inches of each further one."""


LONGEST_NAME = 24
"""Characters of a tracker's name beside an axis: 1 in at 7 pt."""
GAP = "\N{HORIZONTAL ELLIPSIS}"


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The numbers behind a drawing, and its legend.

    columns, rows: the figure's .csv; legend: options of matplotlib's `legend`, None for no legend; without `ncols`, as
    many columns as fit.
    """

    columns: ListOf[str]
    rows: Iterable[ListOf[Any]]
    legend: Mapping[str, Any] | None = field(default_factory=dict)


def finite(value: float) -> float | None:
    """The value, or None when it is not finite."""
    return value if np.isfinite(value) else None


def short_names(names: ListOf[str]) -> list[str]:
    """The names with at most LONGEST_NAME characters: long ones without their middles, equal ones by their places."""
    head, tail = LONGEST_NAME // 2 - 1, LONGEST_NAME // 2
    cut = [name if len(name) <= LONGEST_NAME else f"{name[:head]}{GAP}{name[-tail:]}" for name in names]
    places = {name: k for k, name in enumerate(dict.fromkeys(names), 1)}
    alike = {short: {name for name, other in zip(names, cut, strict=True) if other == short} for short in cut}
    return [
        short if len(alike[short]) == 1 else f"{short[:head]}{GAP}({places[name]})"
        for name, short in zip(names, cut, strict=True)
    ]


def legend_of(panel: Axes, options: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `legend` for the labelled artists of a panel, each label once."""
    handles, labels = panel.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    fitting = {"ncols": legend_columns(list(once)), **options}
    return {"handles": list(once.values()), "labels": list(once), **fitting}


def save_panel(draw: Callable[[Axes], Drawn], stem: Path, height_in: float) -> list[Path]:
    """Write a figure of one panel, 3.50 in wide, with its legend on top, and its numbers; the paths of the files.

    The figure is higher than `height_in` where its legend has more than LEGEND_ROWS rows.
    """
    figure = new_figure(height_in, wide=False)
    panel = figure.subplots()
    drawn = draw(panel)
    if drawn.legend is not None and panel.get_legend_handles_labels()[0]:
        legend = legend_of(panel, drawn.legend)
        figure.legend(**legend, loc="outside upper center")
        rows = -(-len(legend["labels"]) // legend["ncols"])
        figure.set_figheight(height_in + LEGEND_ROW_IN * max(0, rows - LEGEND_ROWS))
    return save_figure(figure, stem, drawn.columns, drawn.rows)


def save_drawn(draw: Callable[[Figure], Drawn], stem: Path, height_in: float, *, wide: bool = True) -> list[Path]:
    """Write a figure of several panels, 7.16 in wide (`wide`) or 3.50 in, and its numbers; the paths of the files."""
    figure = new_figure(height_in, wide=wide)
    drawn = draw(figure)
    return save_figure(figure, stem, drawn.columns, drawn.rows)
