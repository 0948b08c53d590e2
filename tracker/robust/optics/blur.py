"""The blur of a run's images, learned from the edges that stand alone."""

import math

from uavbench.tracker.robust.edges.steps.optics_kernels import FIRST_BLUR_PX, PIXEL_PX
from uavbench.tracker.robust.edges.steps.sum_kernels import REACH_PX

MOST_BLUR_PX = REACH_PX / 2
"""Largest blur that the pixels beside an edge tell from a slope."""


class Blur:
    """State: standard deviation px of the blur of lens, pixels and motion, the same in all directions."""

    def __init__(self) -> None:
        self.px, self.frames = FIRST_BLUR_PX, 0

    def learn(self, excess_px2: float, rate: float) -> None:
        """Update with how much more the variance of a frame's blur is, px^2; NaN where unknown.

        rate, in [0, 1]: least weight of a frame. One frame at most doubles or halves the variance.
        """
        if math.isnan(excess_px2):
            return
        self.frames += 1
        square = self.px**2
        square += max(rate, 1 / (1 + self.frames)) * min(max(excess_px2, -square / 2), square)
        self.px = min(max(math.sqrt(square), PIXEL_PX), MOST_BLUR_PX)
