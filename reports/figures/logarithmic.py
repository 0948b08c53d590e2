"""Logarithmic axes, with minor ticks only where they are labelled: the house style does not draw them otherwise."""

import math
from typing import Any

from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator


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


def _powers_of_ten(low: float, high: float) -> int:
    """Number of powers of ten on an axis, rounded as in `LogFormatter.set_locs`."""
    return math.floor(math.log(high, 10)) - math.floor(math.nextafter(math.log(low, 10), -math.inf))


def logarithmic(axis: XAxis | YAxis) -> None:
    """Give an axis a logarithmic scale."""
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("log")
    axis.set_minor_locator(LabelledTicks())


def plain_powers(axis: Axis) -> None:
    """Label the powers of ten of a logarithmic axis as plain numbers, `0.1`, without minor ticks."""
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(NullLocator())
