"""Alignment of trajectories on a straight line, whose positions leave a rotation undetermined.

Positions on a line determine its direction and the position along it, but no rotation about it; vertical motion
determines no yaw. The smallest rotation is chosen among the equivalent ones.
"""

from dataclasses import dataclass

import numpy as np

from uavbench.trajectories.pose import Array

DEGENERATE = 1e-12
"""Relative round-off of coordinates, and of the second singular value against the first for collinear positions."""
STRAIGHT = 0.01
"""Largest ratio of lateral to longitudinal spread (rms) of nearly collinear positions: 15 cm over 50 m."""
EXACT = 1e-6
"""The same ratio for exactly collinear positions: 1e-9 m, the last digit of most files, over 1 mm."""
SHARED = 0.5
"""Least correlation of both lateral motions, after the best rotation, for it to count as more than noise."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """The smallest rotation (3, 3) that maps the estimate's line onto the reference's, and a message about it."""

    rotation: Array
    said: str


def line_fit(p: Array, q: Array) -> LineFit | None:
    """Fit of positions q to p (n, 3) in metres where one of them lies on a straight line; None where neither does."""
    p_centred, q_centred = p - p.mean(axis=0), q - q.mean(axis=0)
    if len(p) < 2 or not (moves(p, p_centred) and moves(q, q_centred)):
        return None
    straight = [_width(p_centred), _width(q_centred)]
    if not min(straight) < STRAIGHT:
        return None
    U, _, Vt = np.linalg.svd(p_centred.T @ q_centred)
    u, v = U[:, 0], Vt[0]  # the directions that least squares maps onto each other
    R, plane = smallest_rotation(v, u), _across(u)
    if not _undetermined(min(straight), p_centred @ plane.T, q_centred @ R.T @ plane.T):
        return None
    which = [name for name, ratio in zip(("reference", "estimate"), straight, strict=True) if ratio < STRAIGHT]
    return LineFit(
        R,
        f"straight line: the matched positions of the {' and the '.join(which)} lie on one, which leaves the rotation "
        "about it undetermined; the smallest rotation that maps one line to the other was used",
    )


def vertical_fit(p: Array, q: Array) -> LineFit | None:
    """The same for yaw alone: vertical motion leaves the yaw undetermined, and none is applied."""
    p_centred, q_centred = p - p.mean(axis=0), q - q.mean(axis=0)
    if len(p) < 2 or not (moves(p, p_centred) and moves(q, q_centred)):
        return None
    with np.errstate(divide="ignore"):
        straight = min(np.linalg.norm(each[:, :2]) / np.linalg.norm(each[:, 2]) for each in (p_centred, q_centred))
    if not _undetermined(float(straight), p_centred[:, :2], q_centred[:, :2]):
        return None
    return LineFit(
        np.eye(3),
        "straight line: the matched positions move up and down, which leaves the yaw undetermined; none was applied",
    )


def smallest_rotation(source: Array, target: Array) -> Array:
    """Rotation (3, 3) by the smallest angle that takes one unit vector (3,) to another."""
    cosine = float(source @ target)
    if cosine < DEGENERATE - 1:  # half a turn about any orthogonal axis
        axis = _across(source)[0]
        return np.asarray(2 * np.outer(axis, axis) - np.eye(3))
    x, y, z = np.cross(source, target)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1 + cosine))


def moves(points: Array, centred: Array) -> bool:
    """Whether points (n, 3) spread by more than the round-off of their coordinates."""
    return bool(np.abs(centred).max() > DEGENERATE * np.abs(points).max())


def _width(centred: Array) -> float:
    """Ratio of lateral to longitudinal spread (rms) of centred points (n, 3)."""
    second, first = np.linalg.eigvalsh(centred.T @ centred)[1:]
    return float(np.sqrt(max(second, 0.0) / first))


def _across(direction: Array) -> Array:
    """Two unit vectors (2, 3) orthogonal to a direction (3,) and to each other, right-handed about it."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def _undetermined(straight: float, a: Array, b: Array) -> bool:
    """Whether lateral motions a and b (n, 2) are too small, or too different, to determine a rotation between them."""
    if straight < EXACT:
        return True
    C = a.T @ b
    shared = np.hypot(C[0, 0] + C[1, 1], C[1, 0] - C[0, 1]) / np.sqrt((a**2).sum() * (b**2).sum())
    return bool(straight < STRAIGHT and shared < SHARED)
