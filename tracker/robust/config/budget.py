"""The work that a frame may take."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from uavbench.tracker.robust.config.bounds import Count

LONGEST_S = 1.0
"""Time since the frame before that counts at most, so that a frame after a long gap is not late."""


@dataclass(frozen=True)
class BudgetConfig:
    """Work of a frame, in evaluations: edge points looked up in an image.

    Counted, not timed, so that the same frames give the same poses on any machine. The fits that tracking takes count
    and are always made; relocalization does what is left.
    """

    evaluations: Count = 5_000_000
    """Evaluations that a frame may take: 10 ms at 2 ns each. Measured against tracked frames, half of
    which take 0.5 ms (box) on one quiet core of an AMD EPYC (Zen 4)."""
    evaluations_per_s: Annotated[int, Ge(0)] = 50_000_000
    """Evaluations that it may take for each second since the frame before, where that is more: a tenth of that time.
    Measured on bridges at 2 Hz: with 10 ms 11 of 59 frames are found, with 50 ms about 50."""

    def allowed(self, step_s: float) -> int:
        """Evaluations of a frame that comes step_s after the one before."""
        return max(self.evaluations, int(self.evaluations_per_s * min(step_s, LONGEST_S)))
