"""Errors in the space of the structure, as BOP defines them, and of its visible edges in the image.

Conventions: v are points of the model in the structure's frame, P and Q true and estimated cam_from_world. A symmetry
S maps the structure onto itself, world to world.

ADD  mean_v |P v - Q v| (Hinterstoisser et al. 2012). MSSD  min_S max_v |Q v - P S v|. MSPD  min_S max_v |proj Q v -
proj P S v| (Hodan et al. 2020, eq. 1 and 2).
"""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass

import numpy as np

from reports.summary import ErrorSummary
from scenes.camera import Camera
from scenes.sequence import Sequence
from scenes.structure import Structure
from tracker.results import Results
from tracker.visible_edges import pinhole, visible_edges
from trajectories.pose import Array, Pose

SYMMETRY_TOLERANCE = 1e-3
"""Share of the structure's size that a symmetry may move a vertex from its image by."""
POINTS_PER_EDGE = 11
NEAREST_M = 1e-3


@dataclass(frozen=True, kw_only=True)
class ModelSpace:
    """Errors in the structure's space over the frames that have a pose; None where there is none."""

    add_m: ErrorSummary | None
    mssd_m: ErrorSummary | None
    mspd_px: ErrorSummary | None
    edges_px: ErrorSummary | None
    symmetries: int


def model_space(sequence: Sequence, results: Results) -> ModelSpace:
    """Errors of a run in the structure's space and in the image."""
    symmetries = box_symmetries(sequence.structure)
    rows = []
    for frame, row in zip(results.frames.tolist(), results.rows, strict=True):
        if row.cam_from_world is None or not np.isfinite(row.cam_from_world.matrix).all():
            continue
        truth, estimate = sequence.true_cam_from_world(frame), row.cam_from_world
        points = sequence.structure.vertices
        rows.append([
            add(points, truth, estimate),
            mssd(points, truth, estimate, symmetries),
            mspd(points, truth, estimate, symmetries, sequence.camera),
            edge_reprojection(sequence.structure, sequence.camera, truth, estimate),
        ])  # fmt: skip
    table = np.array(rows).reshape(-1, 4)
    found = [ErrorSummary.of(k) if len(k := column[np.isfinite(column)]) else None for column in table.T]
    return ModelSpace(add_m=found[0], mssd_m=found[1], mspd_px=found[2], edges_px=found[3], symmetries=len(symmetries))


def add(points: Array, truth: Pose, estimate: Pose) -> float:
    """Mean distance in m of the model's points (n, 3) at both poses."""
    return float(np.linalg.norm(truth.transform(points) - estimate.transform(points), axis=1).mean())


def mssd(points: Array, truth: Pose, estimate: Pose, symmetries: ListOf[Pose]) -> float:
    """Maximum symmetry-aware surface distance in m."""
    at = estimate.transform(points)
    return min(float(np.linalg.norm(at - (truth @ s).transform(points), axis=1).max()) for s in symmetries)


def mspd(points: Array, truth: Pose, estimate: Pose, symmetries: ListOf[Pose], camera: Camera) -> float:
    """Maximum symmetry-aware projection distance in px; infinite when a point lies behind either camera."""
    at = _pixels(estimate.transform(points), camera)
    if not np.isfinite(at).all():
        return float("inf")
    return min(
        float(np.linalg.norm(at - _pixels((truth @ s).transform(points), camera), axis=1).max()) for s in symmetries
    )


def edge_reprojection(structure: Structure, camera: Camera, truth: Pose, estimate: Pose) -> float:
    """Mean distance in px between the same points of the truly visible edges, projected at both poses."""
    ends = visible_edges(structure, camera, truth).segments_m
    if not len(ends):
        return float("nan")
    w = np.linspace(0, 1, POINTS_PER_EDGE)[None, :, None]
    points = (ends[:, :1] + w * (ends[:, 1:] - ends[:, :1])).reshape(-1, 3)
    apart = _pixels(truth.transform(points), camera) - _pixels(estimate.transform(points), camera)
    return float(np.linalg.norm(apart, axis=1).mean())


def box_symmetries(structure: Structure) -> tuple[Pose, ...]:
    """Rotations about the middle of its bounds that map the vertices onto themselves, the identity first.

    Tried are the 24 rotations of a cube; a box of three different sides has 4 of them, a cube all.
    """
    points = structure.vertices
    low, high = structure.bounds
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    found = []
    for R in _cube_rotations():
        moved = (points - middle) @ R.T + middle
        nearest = (
            np.sqrt(((moved[:, None] - points[None]) ** 2).sum(axis=2)).min(axis=1) if len(points) <= 2000 else None
        )
        if nearest is not None and nearest.max() <= SYMMETRY_TOLERANCE * size:
            found.append(Pose(R, middle - R @ middle))
    return tuple(found) or (Pose.identity(),)


def _cube_rotations() -> list[Array]:
    rotations = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, -1).T:
            R = np.eye(3)[list(order)] * signs
            if np.linalg.det(R) > 0:
                rotations.append(R)
    return sorted(rotations, key=lambda R: -float(np.trace(R)))


def _pixels(points_cam: Array, camera: Camera) -> Array:
    behind = points_cam[:, 2] <= NEAREST_M
    pixels = pinhole(np.where(behind[:, None], [0.0, 0.0, 1.0], points_cam), camera)
    return np.where(behind[:, None], np.inf, pixels)
