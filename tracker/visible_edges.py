"""Step 4, model projection: the visible edges of the structure and their projections.

A face is visible when dot(face normal, camera ray) < 0; a visible edge is adjacent to a visible face (Harris & Stennett
1990). Occlusion by other parts of the structure is computed for drawings only (`images.seen_edges`).

Pixels are those of the undistorted image, in which trackers work.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Array, Pose

NEAR_PART = 1e-3
"""Near plane, in diagonals of the structure's bounding box, since a model may be in any unit: 0.6 mm for a box of
0.5 m, 30 mm for a bridge of 30 m. It only keeps divisions by the depth finite.
"""

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ProjectedEdges:
    """The parts of the visible edges within the image.

    edges (k,): rows in `structure.edges`; segments_px (k, 2, 2): undistorted pixels of their ends; segments_m
    (k, 2, 3): the same ends in the world; depths_m (k, 2): their depths in the camera.
    """

    edges: Indices
    segments_px: Array
    segments_m: Array
    depths_m: Array

    @property
    def lengths_px(self) -> Array:
        """Length of each segment (k,)."""
        return np.asarray(np.linalg.norm(self.segments_px[:, 1] - self.segments_px[:, 0], axis=1))


def visible_edges(structure: Structure, camera: Camera, cam_from_world: Pose) -> ProjectedEdges:
    """Visible edges of a structure, clipped to the image and to the near depth."""
    edges = np.flatnonzero(touching_visible_face(structure, cam_from_world))
    world = structure.edge_segments[edges]
    cam = cam_from_world.transform(world.reshape(-1, 3)).reshape(-1, 2, 3)
    start, end = clip_to_view(cam, camera, near_depth(structure))
    inside = start < end
    edges, world, cam = edges[inside], world[inside], cam[inside]
    parts = np.stack([start[inside], end[inside]], axis=1)[..., None]
    segments_cam = cam[:, :1] + parts * (cam[:, 1:] - cam[:, :1])
    segments_m = world[:, :1] + parts * (world[:, 1:] - world[:, :1])
    return ProjectedEdges(edges, pinhole(segments_cam, camera), segments_m, segments_cam[..., 2])


def visible_faces(structure: Structure, cam_from_world: Pose) -> NDArray[np.bool_]:
    """Mask (f,) of the planar faces whose outside faces the camera."""
    eye = cam_from_world.inverse().translation
    facing: NDArray[np.bool_] = np.einsum("ij,ij->i", structure.face_normals, structure.face_points - eye) < 0
    return facing


def touching_visible_face(structure: Structure, cam_from_world: Pose) -> NDArray[np.bool_]:
    """Mask (e,) of the edges that are adjacent to a visible face."""
    visible = np.append(visible_faces(structure, cam_from_world), False)
    return np.asarray(visible[structure.edge_faces].any(axis=1))


def near_depth(structure: Structure) -> float:
    """Least depth that is projected, in units of the structure."""
    low, high = structure.bounds
    return NEAR_PART * float(np.linalg.norm(high - low))


class SharesInView(NamedTuple):
    """Start and end of the visible part of each segment (k,), as fractions of its length."""

    start: Array
    end: Array


def clip_to_view(segments_cam: Array, camera: Camera, near: float) -> SharesInView:
    """Start and end of the visible part of each segment (k, 2, 3) in the camera frame, as fractions of its length.

    Start >= end if no part of a segment is in view (Liang & Barsky 1984, with the planes of the view frustum).
    Vectorized in numpy: geometry_kernels.clip_segment sums in another order, which would change shang_shen's poses.
    """
    x0, y0, x1, y1 = undistorted_bounds(camera)
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    planes = np.array(
        [[0, 0, 1, -near], [fx, 0, cx - x0, 0], [-fx, 0, x1 - cx, 0], [0, fy, cy - y0, 0], [0, -fy, y1 - cy, 0]]
    )
    distance = segments_cam @ planes[:, :3].T + planes[:, 3]  # (k, 2, 5), positive inside
    a, b = distance[:, 0], distance[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = a / (a - b)
    start = np.where(a < 0, np.where(b < 0, np.inf, crossing), 0.0).max(axis=1)
    end = np.where(b < 0, np.where(a < 0, -np.inf, crossing), 1.0).min(axis=1)
    return SharesInView(start, end)


def pinhole(points_cam_m: Array, camera: Camera) -> Array:
    """Undistorted pixels (..., 2) of points (..., 3) in the camera frame."""
    xy = points_cam_m[..., :2] / points_cam_m[..., 2:]
    return np.asarray(xy * [camera.fx, camera.fy] + [camera.cx, camera.cy])


def to_image(pixels: Array, camera: Camera) -> Array:
    """Pixels (n, 2) of the distorted image for undistorted pixels (n, 2)."""
    if camera.distortion_model == "none":
        return pixels
    return camera.project(camera.without_distortion.rays(pixels))


class Bounds(NamedTuple):
    """Smallest and largest x and y, px."""

    x0: float
    y0: float
    x1: float
    y1: float


@lru_cache(maxsize=64)
def undistorted_bounds(camera: Camera) -> Bounds:
    """Smallest x, y and largest x, y of the image's border without distortion, px."""
    x, y = np.linspace(-0.5, camera.width - 0.5, 33), np.linspace(-0.5, camera.height - 0.5, 33)
    border = np.concatenate(
        [np.column_stack([x, np.full(33, v)]) for v in (y[0], y[-1])]
        + [np.column_stack([np.full(33, u), y]) for u in (x[0], x[-1])]
    )
    flat = camera.undistort(border)
    low, high = flat.min(axis=0), flat.max(axis=0)
    return Bounds(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
