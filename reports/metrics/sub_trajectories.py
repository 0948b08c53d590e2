"""Errors over sub-trajectories of given lengths, as KITTI and rpg report them.

Conventions: E = (P_i^-1 P_j)^-1 (Q_i^-1 Q_j), P the reference, over the interval from pose i to pose j, which is
`length_m` along the reference. `percent`: |t_E| in percent of the length; `deg_per_m`: its angle over the length. Yaw
and tilt split the rotation of E, written in the world frame of the estimate, into Euler angles about z, y and x: tilt
is the norm of the last two.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from uavbench.reports.metrics.association import Indices, PosePairs
from uavbench.reports.metrics.quaternions import angle, conjugate, multiply, norm
from uavbench.reports.metrics.rpe import relative_motion_errors
from uavbench.reports.metrics.summary_statistics import ErrorSummary
from uavbench.trajectories.pose import Array, rotation_from_quaternion

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
KITTI_STEP = 10
RPG_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5)
RPG_MAX_MISS = 0.2


@dataclass(frozen=True, kw_only=True)
class SegmentErrors:
    """Errors of the sub-trajectories of one length."""

    length_m: float
    translation_m: ErrorSummary
    translation_percent: ErrorSummary
    rotation_deg: ErrorSummary
    rotation_deg_per_m: ErrorSummary
    yaw_deg: ErrorSummary
    tilt_deg: ErrorSummary


def distance_along(positions_m: Array) -> Array:
    """Path length (n,) in metres from the first of positions (n, 3) to each."""
    steps = np.sqrt((np.diff(positions_m, axis=0) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])


class Segments(NamedTuple):
    """First and last rows (k,) of sub-trajectories."""

    first: Indices
    last: Indices


def segment_ends(
    positions_m: Array, length_m: float, rule: Literal["kitti", "rpg"] = "rpg", max_miss: float = RPG_MAX_MISS
) -> Segments:
    """First and last rows of the sub-trajectories of a length along positions (n, 3).

    `kitti`: one starts at every tenth pose and ends at the first pose farther than the length (Geiger et al. 2012).
    `rpg`: one starts at every pose and ends at the pose nearest to the length, within the share max_miss of it (Zhang &
    Scaramuzza 2018). Starts without such an end are left out.
    """
    along = distance_along(positions_m)
    start = np.arange(0, len(along), KITTI_STEP if rule == "kitti" else 1)
    goal = along[start] + length_m
    if rule == "kitti":
        end = np.searchsorted(along, goal, side="right")
        keep = end < len(along)
        return Segments(start[keep], end[keep])
    right = np.minimum(np.searchsorted(along, goal), len(along) - 1)
    left = np.maximum(right - 1, 0)
    end = np.where(np.abs(along[left] - goal) <= np.abs(along[right] - goal), left, right)
    keep = (np.abs(along[end] - goal) < max_miss * length_m) & (end > start)
    return Segments(start[keep], end[keep])


def rpg_lengths(positions_m: Array) -> tuple[float, ...]:
    """Lengths of sub-trajectories in metres: 10 .. 50 percent of the reference's path, to the centimetre below."""
    total = float(distance_along(positions_m)[-1])
    return tuple(float(np.floor(share * total * 100) / 100) for share in RPG_SHARES)


def segment_errors(
    pairs: PosePairs, length_m: float, rule: Literal["kitti", "rpg"] = "rpg", max_miss: float = RPG_MAX_MISS
) -> SegmentErrors:
    """Errors of the sub-trajectories of one length; the summaries are NaN where the path is too short for one."""
    i, j = segment_ends(pairs.reference_m, length_m, rule, max_miss)
    q, t = relative_motion_errors(pairs, i, j)
    meters, degrees = norm(t), np.degrees(angle(q))
    at_end = pairs.estimate_q[j]
    in_world = rotation_from_quaternion(multiply(multiply(at_end, conjugate(q)), conjugate(at_end)))
    yaw = np.abs(np.arctan2(in_world[:, 1, 0], in_world[:, 0, 0]))
    pitch = np.arcsin(np.clip(-in_world[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(in_world[:, 2, 1], in_world[:, 2, 2])
    return SegmentErrors(
        length_m=length_m,
        translation_m=ErrorSummary.of(meters),
        translation_percent=ErrorSummary.of(100.0 * meters / length_m),
        rotation_deg=ErrorSummary.of(degrees),
        rotation_deg_per_m=ErrorSummary.of(degrees / length_m),
        yaw_deg=ErrorSummary.of(np.degrees(yaw)),
        tilt_deg=ErrorSummary.of(np.degrees(np.hypot(pitch, roll))),
    )
