"""Logarithmic axes: ticks between the powers of ten only where they are labelled, since the house style draws none."""

import math
from typing import Any

from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator


class LabelledTicks(LogLocator):
    """Minor ticks of an axis that shows one power of ten at most: matplotlib's formatter labels no others."""

    def __init__(self) -> None:
        super().__init__(subs="auto")

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Places of the ticks between two limits."""
        low, high = sorted((vmin, vmax))
        if low > 0 and _powers_of_ten(low, high) > 1:
            return []
        return super().tick_values(vmin, vmax)


def _powers_of_ten(low: float, high: float) -> int:
    """How many an axis shows, rounded as `LogFormatter.set_locs` does."""
    return math.floor(math.log(high, 10)) - math.floor(math.nextafter(math.log(low, 10), -math.inf))


def logarithmic(axis: XAxis | YAxis) -> None:
    """Give an axis a logarithmic scale."""
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("log")
    axis.set_minor_locator(LabelledTicks())


def plain_powers(axis: Axis) -> None:
    """Label the ticks of a logarithmic axis `0.1` and `100`, and nothing between them."""
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(NullLocator())
