"""Gaps of an estimate: steps between two matched poses that span frames without a pose, over which no line is drawn."""

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array

LOST_FRAMES, LOST_POSES = 1.5, 3.0
"""Periods that a step without a lost frame has at most: of known frames, and of poses alone, as keyframes have them."""


def longest_step_ns(stamps_ns: NDArray[np.int64], asked_ns: NDArray[np.int64] | None) -> float:
    """Longest step in ns between matched poses (n,) without a gap; infinite for fewer than two poses.

    asked_ns: stamps of all frames that the tracker was given, if known; else the usual step between poses counts.
    """
    steps_ns = np.diff(stamps_ns)
    steps_ns = steps_ns[steps_ns > 0]  # several poses may match one of the reference
    if not len(steps_ns):
        return np.inf
    if asked_ns is None or len(asked_ns) < 2:
        return LOST_POSES * float(np.median(steps_ns))
    return LOST_FRAMES * max(float(np.median(np.diff(asked_ns))), float(steps_ns.min()))


def usual_step_ns(stamps_ns: NDArray[np.int64]) -> float:
    """Period in ns of poses (n,): the median of their short steps, of less than 1.5 times the lower quartile of all.

    The others span frames without a pose. Infinite for fewer than two poses.
    """
    steps_ns = np.diff(stamps_ns)
    steps_ns = steps_ns[steps_ns > 0]  # several poses may match one of the reference
    if not len(steps_ns):
        return np.inf
    return float(np.median(steps_ns[steps_ns < 1.5 * np.quantile(steps_ns, 0.25)]))


def with_gaps(values: Array, stamps_ns: NDArray[np.int64], longest_ns: float) -> Array:
    """Values (n, ...) of poses with a row of NaN in each gap, where a line through them ends."""
    before = 1 + np.flatnonzero(np.diff(stamps_ns) > longest_ns)
    return np.insert(np.asarray(values, dtype=np.float64), before, np.nan, axis=0)
