"""Whether an estimate is of other moving axes, of another point of the vehicle, or of a mirrored world."""

from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from uavbench.reports.evaluation.doubts.plausibility import SCALED, turned_deg
from uavbench.reports.metrics.align import Alignment
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.quaternions import rotate
from uavbench.trajectories.pose import Array

LEAST_POSES, POSES, LEAST_M = 20, 5000, 0.02
"""Fewest poses of which another point is told, most that are looked at, and its least distance in m.

Below, it is the tracker's own error.
"""
BETTER = 0.3
"""Errors of position with another point or with a mirror, as a share of those without, below which it is told."""
ROUND_OFF = 1e-6
"""Errors of position, as a share of their spread, up to which they are those of written digits, and tell nothing."""
IN_MIRROR = 0.1
"""Errors of mirrored positions, as a share of their spread, up to which they are those of the reference."""


def doubts_of_frames(raw: PosePairs, aligned: PosePairs, align: Alignment) -> Iterator[str]:
    """Sentences on poses of other axes after an alignment, of another point of the vehicle, and in a mirror."""
    if len(raw) < LEAST_POSES:
        return
    if _is_mirrored(raw):
        yield (
            "the positions of the estimate are those of the reference in a mirror: is one world left-handed, as those "
            "of Unity and Unreal, are two axes exchanged, or has one the wrong sign?"
        )
        return
    if align != "none" and (angle_deg := turned_deg(aligned.estimate_q, aligned.reference_q)):
        yield (
            f"after the alignment the rotations of the estimate are those of the reference, turned by the same "
            f"{angle_deg:.0f} degrees in all poses: is one of the camera and the other of the body, or are the axes "
            "others? Convert one, as by --mount"
        )
    if (point_m := _other_point_m(_thinned(aligned), align)) is not None:
        x, y, z = point_m
        yield (
            f"the positions of the estimate are those of the reference, moved by the same {x:.3f}, {y:.3f}, {z:.3f} m "
            "in the moving axes of the reference: is one of another point of the vehicle, as the camera, the body or "
            "the markers? Convert one, as by --mount"
        )


def _thinned(pairs: PosePairs) -> PosePairs:
    """POSES of the pairs, evenly spread, of more."""
    rows = np.linspace(0, len(pairs) - 1, min(len(pairs), POSES)).astype(np.int64)
    return PosePairs(*(getattr(pairs, field.name)[rows] for field in fields(PosePairs)))


def _other_point_m(pairs: PosePairs, align: Alignment) -> Array | None:
    """The point (3,) of the reference's moving axes that the estimate is of; None where it explains no errors.

    It must explain them far better than another world would, which is moved, turned and scaled. Of an aligned estimate
    the alignment is refined with it.
    """
    errors_m = pairs.estimate_m - pairs.reference_m
    axes = [rotate(pairs.reference_q, np.tile(axis, (len(pairs), 1))) for axis in np.eye(3)]
    world = world_columns(pairs.estimate_m)
    refined = world[:, :, : 0 if align == "none" else 7 if align in SCALED else 6]
    found, rest_m = fitted(np.concatenate([np.stack(axes, axis=2), refined], axis=2), errors_m)
    otherwise_m = fitted(world, errors_m).rest_m
    told = np.linalg.norm(found[:3]) >= LEAST_M and (rest_m**2).sum() < BETTER**2 * (otherwise_m**2).sum()
    return found[:3] if told else None


def world_columns(positions_m: Array) -> Array:
    """How positions (n, 3) move with their world (n, 3, 7): along its axes, about them, and with its scale."""
    middle = positions_m - positions_m.mean(axis=0)
    turned = np.stack([np.cross(axis, middle) for axis in np.eye(3)], axis=2)
    return np.concatenate([np.tile(np.eye(3), (len(middle), 1, 1)), turned, middle[:, :, None]], axis=2)


class Fit(NamedTuple):
    """Factors (k,) of columns, and the rest (n, 3) of errors in m."""

    factors: Array
    rest_m: Array


def fitted(columns: Array, errors_m: Array) -> Fit:
    """Least-squares fit of columns (n, 3, k) to errors (n, 3) in m."""
    flat = columns.reshape(-1, columns.shape[2])
    factors = np.asarray(np.linalg.lstsq(flat, errors_m.reshape(-1), rcond=1e-6)[0])
    return Fit(factors, errors_m - (flat @ factors).reshape(-1, 3))


def _is_mirrored(pairs: PosePairs) -> bool:
    """Whether positions fit in a mirror, at any scale, and far better than without one; a plane is its own mirror."""
    p, q = (m - m.mean(axis=0) for m in (pairs.reference_m, pairs.estimate_m))
    sizes = np.linalg.norm(p), np.linalg.norm(q)
    if not min(sizes) > 0:
        return False
    U, d, Vt = np.linalg.svd(p.T @ q / (sizes[0] * sizes[1]))
    if np.linalg.det(U) * np.linalg.det(Vt) > 0:
        return False
    mirrored, turned = (np.sqrt(max(2 - 2 * total, 0.0)) for total in (d.sum(), d[0] + d[1] - d[2]))
    return bool(mirrored < BETTER * turned and mirrored < IN_MIRROR and turned > ROUND_OFF)
