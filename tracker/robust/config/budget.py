"""Work budget of a frame."""

from dataclasses import dataclass

from uavbench.tracker.robust.config.bounds import Count

SHORTEST_S, LONGEST_S = 0.1, 1.0
"""Lower and upper limit of the frame interval for the budget: motion is smooth at 10 Hz and above, and a frame after a
long gap gets no larger budget.
"""


@dataclass(frozen=True)
class BudgetConfig:
    """Work budget of a frame, in evaluations: edge points looked up in an image.

    Work is counted, not timed, so that the same frames give the same poses on any machine. The fits of tracking count
    and are always made; relocalization uses the rest.
    """

    evaluations: Count = 7_000_000
    """Evaluations allowed per frame: 14 ms at 2 ns each, and in proportion more for frame intervals above 0.1 s.
    Measured against tracked frames, half of which take 0.5 ms (box) on one quiet core of an AMD EPYC (Zen 4); and on
    bridges at 2 Hz, where with 10 ms 11 of 59 frames are found, with 50 ms about 50."""

    def allowed(self, step_s: float) -> int:
        """Evaluations allowed for a frame that comes step_s seconds after the previous one."""
        return max(self.evaluations, int(self.evaluations / SHORTEST_S * min(step_s, LONGEST_S)))

    def is_least(self, step_s: float) -> bool:
        """Whether a frame that comes step_s seconds after the previous one is allowed no more than any frame."""
        return step_s <= SHORTEST_S
