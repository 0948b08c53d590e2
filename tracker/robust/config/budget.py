"""The work that a frame may take."""

from dataclasses import dataclass

from uavbench.tracker.robust.config.bounds import Count

SHORTEST_S, LONGEST_S = 0.1, 1.0
"""Time since the frame before that counts at least and at most: motion is smooth at 10 Hz and more, and a frame after a
long gap is not late."""


@dataclass(frozen=True)
class BudgetConfig:
    """Work of a frame, in evaluations: edge points looked up in an image.

    Counted, not timed, so that the same frames give the same poses on any machine. The fits that tracking takes count
    and are always made; relocalization does what is left.
    """

    evaluations: Count = 5_000_000
    """Evaluations that a frame may take: 10 ms at 2 ns each, and as much for each 0.1 s since the frame before, where
    that is more. Measured against tracked frames, half of which take 0.5 ms (box) on one quiet core of an AMD EPYC
    (Zen 4); on bridges at 2 Hz, where with 10 ms 11 of 59 frames are found, with 50 ms about 50."""

    def allowed(self, step_s: float) -> int:
        """Evaluations of a frame that comes step_s after the one before."""
        return max(self.evaluations, int(self.evaluations / SHORTEST_S * min(step_s, LONGEST_S)))
