"""Score points of the Hilti SLAM Challenge, 0 to 100 for a sequence.

Each frame earns points by its position error, 20 at most; a frame without a pose earns none. Their sum over all frames
is normalized to 0 to 100 (github.com/Hilti-Research/hilti-slam-challenge-2023, README and
evaluation-2023/batch_evaluation.py). There positions are aligned first; here all trackers know the model's frame.
"""

import numpy as np

from uavbench.trajectories.pose import Array

BOUNDS_M = np.array([0.005, 0.01, 0.03, 0.06, 0.10, 0.40])
"""Upper bounds of the errors that earn the POINTS at the same index."""
POINTS = np.array([20.0, 10.0, 6.0, 5.0, 3.0, 1.0, 0.0])
"""Points below each bound, and beyond the last one."""


def frame_points(translation_m: Array) -> Array:
    """Points (n,) from 0 to 20 of frames with position errors (n,), infinite or NaN without a pose."""
    earned: Array = POINTS[np.searchsorted(BOUNDS_M, translation_m, side="right")]
    return earned


def hilti_score(translation_m: Array) -> float:
    """Score from 0 to 100 of a sequence with position errors (n,); 0 without a frame."""
    if not len(translation_m):
        return 0.0
    return float(100.0 * frame_points(translation_m).mean() / POINTS.max())
