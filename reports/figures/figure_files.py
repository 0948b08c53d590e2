"""Common parts of figures: the result of a drawing function, and functions that write its files."""

from collections.abc import Callable, Iterable, Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from uavbench.reports.style import draw_legend, legend_columns, new_figure, save_figure


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The numbers behind a drawing, and its legend.

    columns, rows: the figure's .csv; legend: arguments of `draw_legend`, as of `legend_of`, and of a single panel those
    that differ from it; None for no legend.
    """

    columns: ListOf[str]
    rows: Iterable[ListOf[Any]]
    legend: Mapping[str, Any] | None = field(default_factory=dict)


def finite(value: float) -> float | None:
    """The value, or None when it is not finite."""
    return value if np.isfinite(value) else None


def legend_of(panel: Axes, options: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `draw_legend` for the labelled artists of a panel, each label once."""
    handles, labels = panel.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    return {"handles": list(once.values()), "labels": list(once), "ncols": legend_columns(list(once)), **options}


def save_panel(draw: Callable[[Axes], Drawn], stem: Path, height_in: float) -> list[Path]:
    """Write a figure of one panel, 3.50 in wide, with its legend on top, and its numbers; the paths of the files."""

    def draw_panel(figure: Figure) -> Drawn:
        panel = figure.subplots()
        drawn = draw(panel)
        return drawn if drawn.legend is None else replace(drawn, legend=legend_of(panel, drawn.legend))

    return save_drawn(draw_panel, stem, height_in, wide=False)


def save_drawn(draw: Callable[[Figure], Drawn], stem: Path, height_in: float, *, wide: bool = True) -> list[Path]:
    """Write a figure of several panels, 7.16 in wide (`wide`) or 3.50 in, and its numbers; the paths of the files.

    The figure is higher than `height_in` where its legend needs room.
    """
    figure = new_figure(height_in, wide=wide)
    drawn = draw(figure)
    if drawn.legend is not None:
        figure.set_figheight(height_in + draw_legend(figure, **drawn.legend))
    return save_figure(figure, stem, drawn.columns, drawn.rows)
