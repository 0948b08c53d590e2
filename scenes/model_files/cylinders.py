"""Tessellation of round shapes: a closed cylinder, a disc."""

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.trajectories.pose import Array

SIDES = 36
"""Segments of a full circle; their chordal deviation is 0.4 % of the radius."""
CIRCLE = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(SIDES) / SIDES])
SAME_PART = 1e-3
"""Tolerance, relative to the radius, within which two circles coincide."""


def cylinder(start: Array, end: Array, radius: float) -> Loaded:
    """Closed cylinder about the axis from start (3,) to end (3,), metres; ValueError for zero length or radius."""
    along = end - start
    if not (radius > 0 and np.linalg.norm(along) > 0):
        raise ValueError("a cylinder needs a positive length and radius")
    across = np.eye(3)[np.argmin(np.abs(along))]
    u = np.cross(along, across)
    v = np.cross(along, u)
    top = disc(radius, end, end + u, end + v)
    bottom = disc(radius, start, start + u, start + v)
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    sides = [[k, after, after + SIDES], [k, after + SIDES, k + SIDES]]
    triangles = [np.column_stack(side) for side in sides]
    triangles += [bottom.triangles[:, ::-1], top.triangles + SIDES]
    return Loaded(np.concatenate([bottom.vertices, top.vertices]), np.concatenate(triangles))


def disc(radius: float, centre: Array, one: Array, two: Array) -> Loaded:
    """Disc in the plane of three points (3,), facing the side from which they are counter-clockwise.

    ValueError when the radius is not positive or the points are collinear.
    """
    u, v = one - centre, two - centre
    normal = np.cross(u, v)
    if not (radius > 0 and np.linalg.norm(normal) > 1e-9 * np.linalg.norm(u) * np.linalg.norm(v)):
        raise ValueError("a circle needs a positive radius, and points that are not on a line")
    axes = np.array([u / np.linalg.norm(u), np.cross(normal, u) / np.linalg.norm(np.cross(normal, u))])
    k = np.arange(1, SIDES - 1)
    return Loaded(centre + radius * CIRCLE @ axes, np.column_stack([np.zeros_like(k), k, k + 1]))


def is_end(centre: Array, radius: float, starts: Array, ends: Array, radii: Array) -> NDArray[np.bool_]:
    """Whether a circle coincides with one end of each of n cylinders, to SAME_PART of the radius."""
    away = np.minimum(np.linalg.norm(starts - centre, axis=1), np.linalg.norm(ends - centre, axis=1))
    return np.asarray((away < SAME_PART * radius) & (np.abs(radius - radii) < SAME_PART * radius), dtype=np.bool_)
