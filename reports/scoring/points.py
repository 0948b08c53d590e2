"""Score points of the Hilti SLAM Challenge, 0 to 100 for a sequence.

Each frame earns points by the error of its position, 20 at most; a frame without a pose earns none. Their sum over all
frames is brought to the range from 0 to 100 (github.com/Hilti-Research/hilti-slam-challenge-2023, README and
evaluation-2023/batch_evaluation.py). There positions are aligned first; here the model's frame is known to all.
"""

import numpy as np

from uavbench.trajectories.pose import Array

BOUNDS_M = np.array([0.005, 0.01, 0.03, 0.06, 0.10, 0.40])
"""Errors below which a frame earns the points at the same place."""
POINTS = np.array([20.0, 10.0, 6.0, 5.0, 3.0, 1.0, 0.0])
"""Points by the bound, and those beyond the last one."""


def frame_points(translation_m: Array) -> Array:
    """Points (n,) of frames with these errors (n,), infinite or NaN where there is no pose."""
    earned: Array = POINTS[np.searchsorted(BOUNDS_M, translation_m, side="right")]
    return earned


def hilti_score(translation_m: Array) -> float:
    """Score from 0 to 100 of a sequence whose frames have these errors (n,); 0 without a frame."""
    if not len(translation_m):
        return 0.0
    return float(100.0 * frame_points(translation_m).mean() / POINTS.max())
