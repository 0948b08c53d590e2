"""Alignment of an estimate to a reference: est -> ref.

Conventions: an aligned position is scale * R p + t; an aligned rotation is R times the estimated one. The default
of this project is no alignment: localization is absolute, in the structure's frame. On a straight line only the part of
the alignment that positions determine is estimated (`straight_line`).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.quaternions import multiply
from uavbench.reports.metrics.straight_line import DEGENERATE, line_fit, moves, vertical_fit
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, quaternion_from_rotation, rotation_from_quaternion

Alignment = Literal["none", "se3", "sim3", "scale", "yaw", "origin", "origin-scale"]


@dataclass(frozen=True, eq=False)
class Similarity:
    """Transform of an estimate: scale, rotation (3, 3), translation (3,) in metres, and its undetermined part."""

    scale: float
    rotation: Array
    translation: Array
    undetermined: str = ""

    @classmethod
    def identity(cls) -> "Similarity":
        """The identity."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, pairs: PosePairs) -> PosePairs:
        """Pairs with their estimate transformed."""
        positions = self.scale * (pairs.estimate_m @ self.rotation.T) + self.translation
        q = quaternion_from_rotation(self.rotation)[None]
        return pairs.with_estimate(positions, multiply(q, pairs.estimate_q))


def alignment(pairs: PosePairs, kind: Alignment, first_n: int | None = None) -> Similarity:
    """Transform that brings the estimate to the reference, found from the first n pairs (None: all).

    `scale`: only the scale of sim3. `yaw`: rotation about z and translation. `origin`: the first poses coincide.
    UserError when the rotation is undetermined because the positions do not move.
    """
    if first_n is not None and first_n < 1:
        raise UserError(f"first_n = {first_n}: alignment needs at least one pair")
    p, q = pairs.reference_m[:first_n], pairs.estimate_m[:first_n]
    if kind == "none":
        return Similarity.identity()
    if kind in ("se3", "sim3"):
        return least_squares(p, q, with_scale=kind == "sim3")
    if kind == "scale":
        return Similarity(least_squares(p, q, with_scale=True).scale, np.eye(3), np.zeros(3))
    if kind == "yaw":
        return least_squares_yaw(p, q) if len(p) > 1 else _yaw_of_first(pairs)
    scale = least_squares(p, q, with_scale=True).scale if kind == "origin-scale" else 1.0
    R = _rotation_of_first(pairs)
    return Similarity(scale, R, pairs.reference_m[0] - scale * R @ pairs.estimate_m[0])


def align(pairs: PosePairs, kind: Alignment, first_n: int | None = None) -> PosePairs:
    """Pairs with their estimate aligned."""
    return pairs if kind == "none" else alignment(pairs, kind, first_n).apply(pairs)


def least_squares(p: Array, q: Array, *, with_scale: bool) -> Similarity:
    """Least-squares similarity q -> p of points (n, 3); on a straight line, the one with the smallest rotation."""
    line = line_fit(p, q)
    if line is None:
        return umeyama(p, q, with_scale=with_scale)
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    turned = (q - q_mean) @ line.rotation.T
    scale = float(((p - p_mean) * turned).sum() / (turned**2).sum()) if with_scale else 1.0
    return Similarity(scale, line.rotation, p_mean - scale * line.rotation @ q_mean, line.said)


def least_squares_yaw(p: Array, q: Array) -> Similarity:
    """Least-squares rotation about z and translation q -> p (n, 3); no rotation for vertical motion."""
    line = vertical_fit(p, q)
    if line is None:
        return yaw_alignment(p, q)
    return Similarity(1.0, line.rotation, p.mean(axis=0) - q.mean(axis=0), line.said)


def umeyama(p: Array, q: Array, *, with_scale: bool) -> Similarity:
    """Least-squares similarity q -> p of points (n, 3) (Umeyama 1991, eq. 40-42); UserError when they lie on a line."""
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    p_centred, q_centred = p - p_mean, q - q_mean
    U, d, Vt = np.linalg.svd(p_centred.T @ q_centred / len(p))
    if not (d[1] > DEGENERATE * d[0] and moves(p, p_centred) and moves(q, q_centred)):
        raise UserError(
            f"alignment is undefined: the {len(p)} matched positions of the reference or the estimate do not move "
            "or lie on one line; use --align none, origin or yaw, or a longer trajectory"
        )
    S = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * S) @ Vt
    scale = float(d @ S / (q_centred**2).sum(axis=1).mean()) if with_scale else 1.0
    return Similarity(scale, R, p_mean - scale * R @ q_mean)


def yaw_alignment(p: Array, q: Array) -> Similarity:
    """Least-squares rotation about z and translation, q -> p (n, 3); UserError when the yaw is undetermined."""
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    C = (p - p_mean).T @ (q - q_mean)
    s, c = C[1, 0] - C[0, 1], C[0, 0] + C[1, 1]
    if not np.hypot(s, c) > DEGENERATE * max(((p - p_mean) ** 2).sum(), ((q - q_mean) ** 2).sum()):
        raise UserError(
            "yaw alignment is undefined: the matched positions of the reference or the estimate do not move sideways; "
            "use --align none or origin"
        )
    R = _about_z(float(np.arctan2(s, c)))
    return Similarity(1.0, R, p_mean - R @ q_mean)


def _rotation_of_first(pairs: PosePairs) -> Array:
    first = rotation_from_quaternion(pairs.reference_q[0]) @ rotation_from_quaternion(pairs.estimate_q[0]).T
    return np.asarray(first)


def _yaw_of_first(pairs: PosePairs) -> Similarity:
    R_first = _rotation_of_first(pairs)
    R = _about_z(float(np.arctan2(R_first[1, 0] - R_first[0, 1], R_first[0, 0] + R_first[1, 1])))
    return Similarity(1.0, R, pairs.reference_m[0] - R @ pairs.estimate_m[0])


def _about_z(yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
