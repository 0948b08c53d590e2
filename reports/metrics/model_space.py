"""Errors in the space of the structure, as BOP defines them, and of its visible edges in the image.

Conventions: v are points of the model in the structure's frame, P and Q true and estimated cam_from_world. A symmetry S
maps the structure onto itself, world to world. Poses come as rotations (n, 3, 3) and translations (n, 3).

ADD  mean_v |P v - Q v| (Hinterstoisser et al. 2012). MSSD  min_S max_v |Q v - P S v|. MSPD  min_S max_v |proj Q v -
proj P S v| (Hodan et al. 2020, eq. 1 and 2).
"""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.camera_poses import estimated_cameras, true_cameras
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.structure import Structure
from uavbench.tracker.results import Results
from uavbench.tracker.visible_edges import pinhole
from uavbench.trajectories.pose import Array, Pose

SYMMETRY_TOLERANCE = 1e-3
"""Tolerance of a symmetry: largest distance of a mapped vertex from its image, over the structure's size, and largest
change of the first two moments of the surface, over the size and its square."""
POINTS_PER_EDGE = 11
NEAREST_M = 1e-3
MAX_SYMMETRIC_VERTICES = 2000
BLOCK_POINTS = 200_000
Poses = tuple[Array, Array]


@dataclass(frozen=True, kw_only=True)
class ModelSpace:
    """Errors in the structure's space and of its edges in the image, over the frames with a pose; None without any.

    symmetries: how many rotations map the structure onto itself, the identity included.
    """

    add_m: ErrorSummary | None
    mssd_m: ErrorSummary | None
    mspd_px: ErrorSummary | None
    edges_px: ErrorSummary | None
    symmetries: int


def model_space(sequence: Sequence, results: Results) -> ModelSpace:
    """Errors of a run in the structure's space and in the image."""
    structure, camera = sequence.structure, sequence.camera
    symmetries = box_symmetries(structure)
    R, t = estimated_cameras(results)
    ok = np.isfinite(t).all(axis=1)
    ground_truth = true_cameras(sequence, results.frames[ok].tolist())
    estimate = R[ok], t[ok]
    points = structure.vertices
    columns = [np.full(int(ok.sum()), np.nan) for _ in range(4)]
    step = max(1, BLOCK_POINTS // max(len(points), POINTS_PER_EDGE * len(structure.edges)))
    for start in range(0, len(columns[0]), step):
        block = slice(start, start + step)
        P, Q = (ground_truth[0][block], ground_truth[1][block]), (estimate[0][block], estimate[1][block])
        columns[0][block] = add(points, P, Q)
        columns[1][block] = mssd(points, P, Q, symmetries)
        columns[2][block] = mspd(points, P, Q, symmetries, camera)
        columns[3][block] = edge_reprojection(structure, camera, P, Q)
    found = [ErrorSummary.of(k) if len(k := column[np.isfinite(column)]) else None for column in columns]
    return ModelSpace(add_m=found[0], mssd_m=found[1], mspd_px=found[2], edges_px=found[3], symmetries=len(symmetries))


def add(points: Array, ground_truth: Poses, estimate: Poses) -> Array:
    """Mean distance (n,) in m of the model's points (v, 3) at both poses."""
    return np.asarray(np.linalg.norm(_at(points, ground_truth) - _at(points, estimate), axis=2).mean(axis=1))


def mssd(points: Array, ground_truth: Poses, estimate: Poses, symmetries: ListOf[Pose]) -> Array:
    """Maximum symmetry-aware surface distance (n,) in m."""
    at = _at(points, estimate)
    each = [np.linalg.norm(at - _at(s.transform(points), ground_truth), axis=2).max(axis=1) for s in symmetries]
    return np.asarray(np.min(each, axis=0))


def mspd(points: Array, ground_truth: Poses, estimate: Poses, symmetries: ListOf[Pose], camera: Camera) -> Array:
    """Maximum symmetry-aware projection distance (n,) in px, at most the image's diagonal.

    It is the diagonal where a point lies behind a camera, so that such a frame is not left out.
    """
    at = _pixels(_at(points, estimate), camera)
    each = []
    for symmetry in symmetries:
        with np.errstate(invalid="ignore"):  # a point behind both cameras
            apart = at - _pixels(_at(symmetry.transform(points), ground_truth), camera)
        distance = np.linalg.norm(apart, axis=2)
        each.append(np.where(np.isnan(distance), np.inf, distance).max(axis=1))
    return np.asarray(np.minimum(np.min(each, axis=0), diagonal_px(camera)))


def edge_reprojection(structure: Structure, camera: Camera, ground_truth: Poses, estimate: Poses) -> Array:
    """Mean distance (n,) in px between points of the edges, projected at both poses.

    Only points that are in the image at the true pose and on an edge of a visible face are used; NaN without any. At
    most the image's diagonal per point.
    """
    ends = structure.edge_segments
    w = np.linspace(0, 1, POINTS_PER_EDGE)[None, :, None]
    points = (ends[:, :1] + w * (ends[:, 1:] - ends[:, :1])).reshape(-1, 3)
    eyes = -np.einsum("nji,nj->ni", *ground_truth)
    _, first = np.unique(structure.triangle_face, return_index=True)
    on_face = structure.vertices[structure.triangles[first, 0]]
    toward = np.einsum("fj,nfj->nf", structure.face_normals, on_face - eyes[:, None]) < 0
    toward = np.concatenate([toward, np.zeros((len(toward), 1), dtype=bool)], axis=1)
    seen = np.repeat(toward[:, structure.edge_faces].any(axis=2), POINTS_PER_EDGE, axis=1)
    here, there = _pixels(_at(points, ground_truth), camera), _pixels(_at(points, estimate), camera)
    middle, half = np.array([camera.width - 1, camera.height - 1]) / 2, np.array([camera.width, camera.height]) / 2
    inside = seen & (np.abs(here - middle) <= half).all(axis=2)
    apart = np.where(inside[..., None], there, 0.0) - np.where(inside[..., None], here, 0.0)
    distance = np.minimum(np.linalg.norm(apart, axis=2), diagonal_px(camera))
    count = inside.sum(axis=1)
    return np.where(count > 0, distance.sum(axis=1) / np.maximum(count, 1), np.nan)


def diagonal_px(camera: Camera) -> float:
    """Length of the image's diagonal."""
    return float(np.hypot(camera.width, camera.height))


@lru_cache(maxsize=16)
def box_symmetries(structure: Structure) -> tuple[Pose, ...]:
    """Rotations about the middle of its bounds that map vertices and surface onto themselves, the identity first.

    The 24 rotations of a cube are tried; a box of three different sides has 4 of them, a cube all. A box without its
    lid has the vertices of a whole one, but not the same moments of the surface.
    """
    points = structure.vertices
    low, high = structure.bounds
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    if len(points) > MAX_SYMMETRIC_VERTICES:
        return (Pose.identity(),)
    found, moments = [], _surface_moments((points - middle) / size, structure.triangles)
    for R in _cube_rotations():
        moved = (points - middle) @ R.T + middle
        nearest = np.sqrt(((moved[:, None] - points[None]) ** 2).sum(axis=2)).min(axis=1)
        away = np.abs(R @ moments.first - moments.first), np.abs(R @ moments.second @ R.T - moments.second)
        if nearest.max() <= SYMMETRY_TOLERANCE * size and max(each.max() for each in away) <= SYMMETRY_TOLERANCE:
            found.append(Pose(R, middle - R @ middle))
    return tuple(found) or (Pose.identity(),)


class Moments(NamedTuple):
    """First moment (3,) and second moments (3, 3) of a surface of unit area."""

    first: Array
    second: Array


def _surface_moments(points: Array, triangles: NDArray[np.int64]) -> Moments:
    """Moments of triangles (m, 3) of points: integrals of x and of x x^T, exact for linear x over a triangle."""
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    part, total = area / area.sum(), corners.sum(axis=1)
    squares = np.einsum("mci,mcj->mij", corners, corners) + np.einsum("mi,mj->mij", total, total)
    return Moments(part @ total / 3, np.einsum("m,mij->ij", part, squares) / 12)


def _cube_rotations() -> list[Array]:
    rotations = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, -1).T:
            R = np.eye(3)[list(order)] * signs
            if np.linalg.det(R) > 0:
                rotations.append(R)
    return sorted(rotations, key=lambda R: -float(np.trace(R)))


def _at(points: Array, poses: Poses) -> Array:
    """Points (v, 3) in the camera of each pose (n, v, 3)."""
    R, t = poses
    return np.asarray(points @ np.swapaxes(R, 1, 2) + t[:, None])


def _pixels(points_cam: Array, camera: Camera) -> Array:
    """Undistorted pixels (n, v, 2), infinite behind the camera."""
    behind = points_cam[..., 2:] <= NEAREST_M
    return np.where(behind, np.inf, pinhole(np.where(behind, 1.0, points_cam), camera))
