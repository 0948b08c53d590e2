"""NEES of paired poses whose file claims covariances.

Conventions: NEES is e^T P^-1 e, where e is the error that the covariance P describes (`PoseCovariances`); for a
consistent estimator it is chi-square distributed with 6 degrees of freedom (Bar-Shalom, Li & Kirubarajan 2001,
section 5.4).
"""

import numpy as np

from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.quaternions import between, conjugate, multiply, rotate_back
from uavbench.reports.uncertainty.consistency import Consistency, consistency_of
from uavbench.reports.uncertainty.whitened_errors import squares, whitened
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory_files.covariances import PoseCovariances

SMALL_RAD = 1e-5
"""Angle below which the coefficient of SE(3)'s logarithm is replaced by its limit, 1/12."""


def pose_nees(pairs: PosePairs, claimed: PoseCovariances) -> Array:
    """NEES (n,) of n pairs; NaN where the estimate has no covariance, infinite where it is singular.

    claimed: covariances (n, 6, 6) of the estimates, in the order of the pairs.
    """
    return squares(whitened_pose_errors(pairs, claimed))


def whitened_pose_errors(pairs: PosePairs, claimed: PoseCovariances) -> Array:
    """Whitened errors (n, 6) of n pairs in the order of time; NaN where the estimate has no covariance.

    claimed: covariances (n, 6, 6) of the estimates, in the order of the pairs.
    """
    errors = _twists(pairs) if claimed.axes == "moving" else _errors_in_world(pairs)
    out = np.full(errors.shape, np.nan)
    known = np.isfinite(claimed.values).all(axis=(1, 2))
    out[known] = whitened(errors[known], claimed.values[known])
    return out


def pose_consistency(pairs: PosePairs, claimed: PoseCovariances) -> Consistency | None:
    """Summary of the NEES of pairs; None when no pair has a covariance."""
    variances = np.einsum("nii->ni", claimed.values)
    return consistency_of(whitened_pose_errors(pairs, claimed), variances[np.isfinite(variances).all(axis=1)])


def _errors_in_world(pairs: PosePairs) -> Array:
    """Position error in m and rotation vector of R_true R^T in rad (n, 6), in the axes of the world."""
    turn = multiply(pairs.reference_q, conjugate(pairs.estimate_q))
    return np.column_stack([pairs.reference_m - pairs.estimate_m, _rotation_vectors(turn)])


def _twists(pairs: PosePairs) -> Array:
    """Twists xi (n, 6) with world_from_x_true = world_from_x exp(xi): `Pose.log`, vectorized."""
    phi = _rotation_vectors(between(pairs.estimate_q, pairs.reference_q))
    t = rotate_back(pairs.estimate_q, pairs.reference_m - pairs.estimate_m)
    angle = np.linalg.norm(phi, axis=1)
    safe = np.where(angle > SMALL_RAD, angle, 1.0)
    # the half-angle form avoids cancellation in 1 - cos
    c = np.where(angle > SMALL_RAD, (1 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2, 1 / 12)
    across = np.cross(phi, t)
    return np.column_stack([t - 0.5 * across + c[:, None] * np.cross(phi, across), phi])


def _rotation_vectors(q: Array) -> Array:
    """Rotation vectors (n, 3) in rad, norm in [0, pi], of quaternions wxyz (n, 4)."""
    q = np.where(q[:, :1] < 0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=1)
    half = np.arctan2(sine, q[:, 0])
    return np.asarray(q[:, 1:] * np.where(sine > 0, 2 * half / np.where(sine > 0, sine, 1.0), 2.0)[:, None])
