"""Coverage of an inspection: the share of a structure's surface seen at a required resolution."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.random_streams import stream

POINTS = 2000
"""Points on the surface: the standard deviation of the share is then 1.1 % at most (binomial)."""
TOUCHING_M = 1e-3
"""Tolerance in m of the occlusion test."""


class SurfacePoints(NamedTuple):
    """Points (n, 3) in m on a surface, and the outward unit normals (n, 3) there."""

    points: Array
    normals: Array


def surface_points(structure: Structure) -> SurfacePoints:
    """POINTS points uniformly sampled on a structure's surface, the same on every call."""
    rng = stream(0, "coverage")
    a, b, c = (structure.vertices[structure.triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    chosen = rng.choice(len(areas), size=POINTS, p=areas / areas.sum())
    u, v = np.sqrt(rng.random((POINTS, 1))), rng.random((POINTS, 1))
    points = (1 - u) * a[chosen] + u * (1 - v) * b[chosen] + u * v * c[chosen]
    return SurfacePoints(points, structure.face_normals[structure.triangle_face[chosen]])


def coverage(structure: Structure, camera: Camera, cam_from_world: Iterable[Pose], px_m: float) -> float:
    """Share (0 to 1) of the surface seen from any of the poses at px_m pixels per metre of surface, or more."""
    points, normals = surface_points(structure)
    obstacles = ObstacleMesh(structure.vertices, structure.triangles)
    seen = np.zeros(len(points), dtype=bool)
    for pose in cam_from_world:
        rows = np.flatnonzero(~seen)
        seen[rows] = sees(camera, pose, obstacles, points[rows], normals[rows], px_m)
    return float(seen.mean())


def sees(
    camera: Camera, cam_from_world: Pose, obstacles: ObstacleMesh, points: Array, normals: Array, px_m: float
) -> NDArray[np.bool_]:
    """Mask (n,) of the surface points (n, 3) that a camera sees unoccluded at px_m pixels per metre or more.

    normals: outward unit normals (n, 3); points and normals in the world.
    """
    out = np.zeros(len(points), dtype=bool)
    in_cam = cam_from_world.transform(points)
    centre = cam_from_world.inverse().translation
    towards = centre - points
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    facing = np.einsum("ij,ij->i", towards, normals) / distance
    rows = np.flatnonzero((in_cam[:, 2] > 0.01) & (min(camera.fx, camera.fy) * facing / distance >= px_m))
    if not len(rows):
        return out
    rows = rows[camera.in_image(in_cam[rows])]
    if len(rows):
        met = obstacles.ray(np.tile(centre, (len(rows), 1)), -towards[rows] / distance[rows, None])
        out[rows] = met >= distance[rows] - TOUCHING_M
    return out
