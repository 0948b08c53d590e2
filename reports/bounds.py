"""How good a tracker of edges could be: the Cramer-Rao bound of the position of the body in each frame.

Conventions: what can be measured at the true pose is the distance of each control point of the visible edges from its
edge, along the normal, with independent Gaussian noise of sigma_px. For unbiased estimates from one frame, E |p - q|^2
is at least the squared bound (Kay 1993, section 3.7). Trackers that use more than one frame, or more than edges, may
go below.
"""

from collections.abc import Sequence as ListOf

import numpy as np

from reports.runs import ScoredRun
from scenes.sequence import Sequence
from tracker.control_points import control_points
from tracker.visible_edges import visible_edges
from trajectories.pose import Array, hat

SIGMA_PX = 0.3
"""Assumed noise of one edge measurement: an assumption, and written beside every ratio."""
SINGULAR = 1e-12


def position_bounds(sequence: Sequence, frames: ListOf[int], sigma_px: float = SIGMA_PX) -> Array:
    """Bound (n,) in m on the RMS position error of the body, infinite where the edges in view do not fix the pose."""
    out = np.full(len(frames), np.inf)
    camera, mount = sequence.camera, sequence.cam_from_body
    for k, frame in enumerate(frames):
        truth = sequence.true_cam_from_world(frame)
        points = control_points(visible_edges(sequence.structure, camera, truth))
        if len(points) < 6:
            continue
        at = truth.transform(points.points_m)
        x, y, z = at.T
        toward = np.zeros((len(at), 3))  # n^T du/dX
        toward[:, 0] = points.normals[:, 0] * camera.fx / z
        toward[:, 1] = points.normals[:, 1] * camera.fy / z
        toward[:, 2] = -(toward[:, 0] * x + toward[:, 1] * y) / z
        J = np.hstack([toward, np.einsum("ni,nij->nj", toward, -hat(at))])
        values, vectors = np.linalg.eigh(J.T @ J)
        if values[0] <= SINGULAR * values[-1]:
            continue
        covariance = sigma_px**2 * (vectors / values) @ vectors.T
        M = np.hstack([-np.eye(3), hat(mount.translation)])
        out[k] = np.sqrt(np.trace(M @ covariance @ M.T))
    return out


def error_over_bound(run: ScoredRun, sigma_px: float = SIGMA_PX) -> Array:
    """Ratio (n,) of each frame's position error to its bound; infinite where the frame is lost."""
    return run.errors.translation_m / position_bounds(run.sequence, run.errors.frames.tolist(), sigma_px)
