"""Poses as near to a prediction as a fit: those among which a track finds it, and chance may find something else.

They fill the ellipsoid of the prediction's covariance through the fit. After a long frame interval that is as many as a
search tries; right at a prediction it is the fit's alone.
"""

import math

import numpy as np

from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import Motion


def log10_poses_as_near(fit: Fit, predicted: Motion, apart_px: float) -> float:
    """Decimal logarithm of the number of poses as near to a prediction as a fit that look different, at least 0.

    Two poses look different where the control points are apart by so many px in the root mean square; 0 without control
    points, inf where the covariance is not positive definite.
    """
    if fit.searched is None or not len(fit.searched.problem.lines.jacobian):
        return 0.0
    away = predicted.squared_mahalanobis(fit.cam_from_world)
    if not math.isfinite(away):
        return math.inf
    seen = fit.searched.problem.lines.jacobian / apart_px
    root = np.linalg.cholesky(predicted.covariance)
    along = np.linalg.eigvalsh(root.T @ (seen.T @ seen / len(seen)) @ root)
    return 0.5 * sum(math.log10(square) for square in (along * away).tolist() if square > 1.0)
