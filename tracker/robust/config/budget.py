"""The work that a frame may take."""

from dataclasses import dataclass

from uavbench.tracker.robust.config.bounds import Count


@dataclass(frozen=True)
class BudgetConfig:
    """Work of a frame, in evaluations: edge points looked up in an image.

    Counted, not timed, so that the same frames give the same poses on any machine. The fits that tracking takes count
    and are always made; relocalization does what is left.
    """

    evaluations: Count = 5_000_000
    """Evaluations that a frame may take: 10 ms at 2 ns each. Measured against tracked frames, half of
    which take 0.5 ms (box) on one quiet core of an AMD EPYC (Zen 4)."""
    fit_evaluations: Count = 1_500
    """What fitting a control point takes: 3 us. Measured on the same core, on boxes and buildings."""
    distance_evaluations: Count = 450_000
    """What the distances to the edge pixels of an image take: 0.9 ms. Measured on the same core."""
