"""Tessellation of round shapes: a closed cylinder, a disc."""

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.model_files.mesh_piece import Loaded
from uavbench.trajectories.pose import Array

SIDES = 36
"""Segments of a full circle; their chordal deviation is 0.4 % of the radius."""
CIRCLE = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(SIDES) / SIDES])
FAN = np.array([[0, k, k + 1] for k in range(1, SIDES - 1)])
"""Triangles of a disc, by its corners."""
CLOSED = np.array(
    [[k, (k + 1) % SIDES, (k + 1) % SIDES + SIDES] for k in range(SIDES)]
    + [[k, (k + 1) % SIDES + SIDES, k + SIDES] for k in range(SIDES)]
    + [*FAN[:, ::-1].tolist(), *(FAN + SIDES).tolist()]
)
"""Triangles of a cylinder, by the corners of its two discs: its sides, the disc at its start, that at its end."""
SAME_PART = 1e-3
"""Tolerance, relative to the radius, within which two circles coincide."""


def cylinder(start: Array, end: Array, radius: float) -> Loaded:
    """Closed cylinder about the axis from start (3,) to end (3,), metres; ValueError for zero length or radius."""
    along = end - start
    if not (radius > 0 and np.linalg.norm(along) > 0):
        raise ValueError("a cylinder needs a positive length and radius")
    across = np.eye(3)[np.argmin(np.abs(along))]
    u = _cross(along, across)
    v = _cross(along, u)
    bottom, top = (_round(radius, at, at + u, at + v) for at in (start, end))
    return Loaded(np.concatenate([bottom, top]), CLOSED)


def disc(radius: float, centre: Array, one: Array, two: Array) -> Loaded:
    """Disc in the plane of three points (3,), facing the side from which they are counter-clockwise.

    ValueError when the radius is not positive or the points are collinear.
    """
    return Loaded(_round(radius, centre, one, two), FAN)


def _round(radius: float, centre: Array, one: Array, two: Array) -> Array:
    """Corners (SIDES, 3) of a disc; ValueError as `disc`."""
    u, v = one - centre, two - centre
    normal = _cross(u, v)
    length = np.linalg.norm(u)
    if not (radius > 0 and np.linalg.norm(normal) > 1e-9 * length * np.linalg.norm(v)):
        raise ValueError("a circle needs a positive radius, and points that are not on a line")
    across = _cross(normal, u)
    axes = np.array([u / length, across / np.linalg.norm(across)])
    return np.asarray(centre + radius * CIRCLE @ axes)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,), to the bit that of numpy, which takes ten times as long for a single one."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def is_end(centre: Array, radius: float, starts: Array, ends: Array, radii: Array) -> NDArray[np.bool_]:
    """Whether a circle coincides with one end of each of n cylinders, to SAME_PART of the radius."""
    away = np.minimum(np.linalg.norm(starts - centre, axis=1), np.linalg.norm(ends - centre, axis=1))
    return np.asarray((away < SAME_PART * radius) & (np.abs(radius - radii) < SAME_PART * radius), dtype=np.bool_)
