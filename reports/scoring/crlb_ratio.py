"""Cramer-Rao bound on the position of the body in each frame, and the ratio of the errors to it.

Conventions: for unbiased estimates from one frame, E |p - q|^2 is at least the squared bound (Kay 1993, section 3.7).
It is that of the rendered image and its noise where the sequence has it (`crlb`). Otherwise it is that of edges alone,
and rests on an assumption: the measurements at the true pose are the distances of the control points of the visible
edges along their normals, with independent Gaussian noise of sigma_px. Trackers that use several frames may be below
either bound, and those that use more than edges below the second.
"""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uavbench.reports.metrics.frame_errors import FrameErrors
from uavbench.reports.scoring.true_edges import true_edges
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import cam_from_evaluated
from uavbench.tracker.shang_shen.control_points import control_points
from uavbench.trajectories.pose import Array, Pose, hat

SIGMA_PX = 0.3
"""Assumed noise of one edge measurement, reported with every ratio."""
SINGULAR = 1e-12


@dataclass(frozen=True, kw_only=True)
class ErrorOverBound:
    """Median ratio of the position error to the bound of its frame, over the n frames with a pose and a bound."""

    n: int
    median: float

    @classmethod
    def of(cls, sequence: Sequence, errors: FrameErrors) -> "ErrorOverBound | None":
        """Ratio to the bounds of the images; None when no frame with a pose has one."""
        ratios = errors.translation_m / image_bounds(sequence, errors.frames.tolist())
        ratios = ratios[np.isfinite(ratios)]
        return cls(n=len(ratios), median=float(np.median(ratios))) if len(ratios) else None


def image_bounds(sequence: Sequence, frames: ListOf[int]) -> Array:
    """Bound (n,) in m on the RMS position error of the body from each image; NaN where the sequence has none."""
    known, mount = sequence.pose_bounds, cam_from_evaluated(sequence)
    return np.array([_position(known[frame], mount) if frame in known else np.nan for frame in frames])


def edge_bounds(sequence: Sequence, frames: ListOf[int], sigma_px: float = SIGMA_PX) -> Array:
    """Bound (n,) in m on the RMS position error of the body from edges; infinite where the pose is undetermined."""
    return np.array([_edge_bound(sequence, frame, sigma_px) for frame in frames])


@lru_cache(maxsize=4096)  # shared by all trackers
def _edge_bound(sequence: Sequence, frame: int, sigma_px: float) -> float:
    points = control_points(true_edges(sequence, frame))
    if len(points) < 6:
        return np.inf
    camera, at = sequence.camera, sequence.true_cam_from_world(frame).transform(points.points_m)
    x, y, z = at.T
    toward = np.zeros((len(at), 3))  # n^T du/dX
    toward[:, 0] = points.normals[:, 0] * camera.fx / z
    toward[:, 1] = points.normals[:, 1] * camera.fy / z
    toward[:, 2] = -(toward[:, 0] * x + toward[:, 1] * y) / z
    J = np.hstack([toward, np.einsum("ni,nij->nj", toward, -hat(at))])
    values, vectors = np.linalg.eigh(J.T @ J)
    if values[0] <= SINGULAR * values[-1]:
        return np.inf
    return _position(sigma_px**2 * (vectors / values) @ vectors.T, cam_from_evaluated(sequence))


def error_over_bound(sequence: Sequence, errors: FrameErrors) -> Array:
    """Ratio (k,) of the position error to its bound for each frame with a bound; infinite for lost frames."""
    frames = errors.frames.tolist()
    bounds = image_bounds(sequence, frames) if sequence.pose_bounds else edge_bounds(sequence, frames)
    known = ~np.isnan(bounds)
    return np.asarray(errors.translation_m[known] / bounds[known])


def _position(covariance: Array, cam_from_body: Pose) -> float:
    """RMS position error in m of the body, from a covariance (6, 6) of the twist of cam_from_world."""
    M = np.hstack([-np.eye(3), hat(cam_from_body.translation)])
    return float(np.sqrt(np.trace(M @ covariance @ M.T)))
