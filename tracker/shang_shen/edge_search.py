"""Step 7, matching: a 1-D search for candidates from each control point along the edge's normal."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.tracker.protocol import Image
from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.kernels import crossings
from uavbench.tracker.visible_edges import to_image
from uavbench.trajectories.pose import Array

SEARCH_PX = 20.0
"""Half length of a search line, px."""
MAX_ANGLE_DEG = 8.0
"""Largest angle between a candidate segment and the projected edge."""
MAX_CANDIDATES = 5
"""Number of nearest candidates kept per control point."""
REMAP_ROWS = 16384
"""Rows per call of OpenCV's remap, which takes at most 32767."""
MIN_GRADIENT = 8.0
"""Least gradient of a candidate on a grey profile, grey levels per px."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Signed distances (n, k) in px along the normal of each control point, nearest first, inf for none."""

    distances: Array

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of candidates of each control point (n,)."""
        return np.asarray(np.isfinite(self.distances).sum(axis=1))


def search_segments(
    points: ControlPoints, segments: Array, search_px: float = SEARCH_PX, max_angle_deg: float = MAX_ANGLE_DEG
) -> Candidates:
    """Candidates at the crossings of search lines with undistorted segments (m, 4)."""
    if not len(segments) or not len(points):
        return Candidates(np.full((len(points), 1), np.inf))
    distances = np.empty((len(points), MAX_CANDIDATES))
    max_sine = float(np.sin(np.radians(max_angle_deg)))
    crossings(points.pixels, points.normals, segments, search_px, max_sine, distances)
    return Candidates(distances)


def search_edge_pixels(
    points: ControlPoints, edge_image: Image, camera: Camera, search_px: float = SEARCH_PX
) -> Candidates:
    """Candidates at the crossings of search lines with edge pixels (h, w) of the camera's image."""
    steps = np.arange(-search_px, search_px + 1)
    on_edge = profiles(points, edge_image, camera, steps, cv2.INTER_NEAREST) > 0
    first = on_edge.copy()
    first[:, 1:] &= ~on_edge[:, :-1]
    last = on_edge.copy()
    last[:, :-1] &= ~on_edge[:, 1:]
    distances = np.full(on_edge.shape, np.inf)
    row, begin = np.nonzero(first)
    distances[row, begin] = (steps[begin] + steps[np.nonzero(last)[1]]) / 2  # the middle of each run of edge pixels
    return _nearest(distances)


def search_gradient(
    points: ControlPoints,
    gray: Image,
    camera: Camera,
    search_px: float = SEARCH_PX,
    min_gradient: float = MIN_GRADIENT,
) -> Candidates:
    """Candidates at the maxima of the gradient along the search lines, with sub-pixel precision (parabola)."""
    steps = np.arange(-search_px - 2, search_px + 3)
    values = profiles(points, gray, camera, steps, cv2.INTER_LINEAR)
    slope = np.abs(values[:, 2:] - values[:, :-2]) / 2
    before, here, after = slope[:, :-2], slope[:, 1:-1], slope[:, 2:]
    top = (here >= min_gradient) & (here >= before) & (here > after)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = np.clip((before - after) / (2 * (before - 2 * here + after)), -0.5, 0.5)
    return _nearest(np.where(top, steps[2:-2] + offset, np.inf))


def profiles(points: ControlPoints, image: Image, camera: Camera, steps: Array, interpolation: int) -> Array:
    """Values (n, k) of an image at the steps (k,) in px along each normal; the border is replicated."""
    at = points.pixels[:, None] + steps[None, :, None] * points.normals[:, None]
    if not len(points):
        return np.zeros((0, len(steps)))
    where = to_image(at.reshape(-1, 2), camera).reshape(at.shape).astype(np.float32)
    u, v = np.ascontiguousarray(where[..., 0]), np.ascontiguousarray(where[..., 1])
    rows = [
        cv2.remap(image, u[i : i + REMAP_ROWS], v[i : i + REMAP_ROWS], interpolation, borderMode=cv2.BORDER_REPLICATE)
        for i in range(0, len(u), REMAP_ROWS)
    ]
    return np.concatenate(rows).astype(np.float64)


def _nearest(distances: Array, most: int = MAX_CANDIDATES) -> Candidates:
    order = np.argsort(np.abs(distances), axis=1, kind="stable")[:, :most]
    return Candidates(np.take_along_axis(distances, order, axis=1))
