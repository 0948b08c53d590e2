"""Consistency of a tracker's covariances: NEES, and standard deviations of the body's pose.

Conventions: a tracker's covariance P is that of the twist xi with cam_from_world_true = exp(xi) cam_from_world,
translation first, in m and rad. NEES is xi^T P^-1 xi; for a consistent estimator it is chi-square distributed with 6
degrees of freedom (Bar-Shalom, Li & Kirubarajan 2001, section 5.4).
"""

import numpy as np

from uavbench.reports.uncertainty.consistency import Consistency, consistency_of
from uavbench.reports.uncertainty.whitened_errors import SINGULAR, squares, whitened
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results
from uavbench.trajectories.pose import Array, Pose, hat


def nees(sequence: Sequence, results: Results) -> Array:
    """NEES (n,) of each row; NaN without a pose or covariance, infinite for a singular covariance."""
    return squares(whitened_twists(sequence, results))


def whitened_twists(sequence: Sequence, results: Results) -> Array:
    """Whitened errors (n, 6) of each row, as `whitened_errors` defines them."""
    out = np.full((len(results), 6), np.nan)
    for i, (frame, row) in enumerate(zip(results.frames.tolist(), results.rows, strict=True)):
        if row.cam_from_world is None or row.covariance is None:
            continue
        xi = (sequence.true_cam_from_world(frame) @ row.cam_from_world.inverse()).log()
        out[i] = whitened(xi[None], row.covariance[None])[0]
    return out


def consistency(sequence: Sequence, results: Results) -> Consistency | None:
    """Summary of the NEES of a run; None when its tracker claims no covariance.

    Its sharpness is that of the pose whose errors are scored, `world_from_body`; NEES is the same for every point.
    """
    return consistency_of(whitened_twists(sequence, results), _body_variances(results))


def is_singular(covariance: Array) -> bool:
    """Whether a covariance (6, 6) is singular in float64 or indefinite; independent of the units of its components."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not (spread > 0).all():
        return True
    least = float(np.linalg.eigvalsh(covariance / spread / spread[:, None])[0])
    return not least > SINGULAR


def component_sigmas(results: Results) -> Array:
    """Standard deviations (n, 6) of the body's x y z (m) and roll pitch yaw (rad); NaN where none is claimed.

    To first order: the body is at R_wc t + p_c with t its position in the camera, so dp = R_wc (hat(t) phi - rho); its
    rotation changes by -R_wc phi in the world, from which the ZYX Euler rates follow.
    """
    out = np.full((len(results), 6), np.nan)
    mount = results.cam_from_body
    for i, row in enumerate(results.rows):
        if row.cam_from_world is None or row.covariance is None:
            continue
        R = row.cam_from_world.rotation.T
        J = np.zeros((6, 6))
        J[:3] = _of_position(row.cam_from_world, mount)
        J[3:, 3:] = -np.linalg.solve(_euler_rates(R @ mount.rotation), R)
        out[i] = np.sqrt(_variances(J, row.covariance))
    return out


def _body_variances(results: Results) -> Array:
    """Variances (m, 6) of the position of the body in world axes (m^2) and of its rotation in the camera's (rad^2).

    Of the m rows with a pose and a covariance; they sum to the same in all axes.
    """
    J = np.eye(6)
    rows = []
    for row in results.rows:
        if row.cam_from_world is not None and row.covariance is not None:
            J[:3] = _of_position(row.cam_from_world, results.cam_from_body)
            rows.append(_variances(J, row.covariance))
    return np.array(rows).reshape(-1, 6)


def _of_position(cam_from_world: Pose, cam_from_body: Pose) -> Array:
    """Jacobian (3, 6) of the position of the body in the world with respect to the twist of `cam_from_world`."""
    R = cam_from_world.rotation.T
    return np.hstack([-R, R @ hat(cam_from_body.translation)])


def _variances(J: Array, covariance: Array) -> Array:
    """Diagonal (k,) of J P J^T for J (k, n), without what round-off makes negative."""
    return np.asarray(np.maximum(np.einsum("ij,jk,ik->i", J, covariance, J), 0.0))


def euler_zyx(q: Array) -> Array:
    """Roll, pitch, yaw (n, 3) in rad of unit quaternions wxyz (n, 4): R = Rz(yaw) Ry(pitch) Rx(roll)."""
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.column_stack([roll, pitch, yaw])


def _euler_rates(R: Array) -> Array:
    """Matrix (3, 3) from roll, pitch and yaw rates to the angular velocity in the world."""
    yaw, pitch = np.arctan2(R[1, 0], R[0, 0]), np.arcsin(np.clip(-R[2, 0], -0.999999, 0.999999))
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c * np.cos(pitch), -s, 0], [s * np.cos(pitch), c, 0], [-np.sin(pitch), 0, 1.0]])
