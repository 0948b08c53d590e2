"""Logarithmic axes, with minor ticks only where they are labelled: the house style does not draw them otherwise."""

import math
from typing import Any

from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.ticker import FuncFormatter, LogFormatterSciNotation, LogLocator, NullFormatter, NullLocator


class LabelledTicks(LogLocator):
    """Locator of minor ticks, for axes with one power of ten at most: matplotlib's formatter labels no others."""

    def __init__(self) -> None:
        super().__init__(subs="auto")

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Positions of the ticks between two limits."""
        low, high = sorted((vmin, vmax))
        if low > 0 and _powers_of_ten(low, high) > 1:
            return []
        return super().tick_values(vmin, vmax)


class PlainWithinADecade(LogFormatterSciNotation):
    """Labels of ticks: plain numbers on an axis with one power of ten at most, where matplotlib has 2x10^0."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of the tick at x, empty for those that have none."""
        label: str = super().__call__(x, pos)
        plain = f"{x:g}"
        if not label or "e" in plain or self.axis is None:
            return label
        low, high = sorted(self.axis.get_view_interval())
        return plain if _powers_of_ten(low, high) <= 1 else label


def _powers_of_ten(low: float, high: float) -> int:
    """Number of powers of ten on an axis, rounded as in `LogFormatter.set_locs`."""
    return math.floor(math.log(high, 10)) - math.floor(math.nextafter(math.log(low, 10), -math.inf))


def logarithmic(axis: XAxis | YAxis) -> None:
    """Give an axis a logarithmic scale."""
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("log")
    axis.set_minor_locator(LabelledTicks())
    axis.set_major_formatter(PlainWithinADecade())
    axis.set_minor_formatter(PlainWithinADecade())


def plain_powers(axis: Axis) -> None:
    """Label the powers of ten of a logarithmic axis as plain numbers, `0.1`, without minor ticks."""
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(NullLocator())
