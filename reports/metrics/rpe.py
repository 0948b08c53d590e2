"""Relative pose error: the error of the motion over an interval of poses.

Conventions: E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), Q the estimate and P the reference. The interval delta is given in
frames, metres of path, degrees or radians of rotation, or seconds; intervals are consecutive, or (all pairs) one
starts at every frame.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from uavbench.reports.metrics.ape import ErrorSizes
from uavbench.reports.metrics.association import NS, Indices, PosePairs
from uavbench.reports.metrics.quaternions import angle, between, chord, norm, rotate_back
from uavbench.trajectories.errors import UserError, refuse_other
from uavbench.trajectories.pose import Array

RpeRelation = Literal[
    "translation_m", "angle_deg", "angle_rad", "rotation", "full", "point_distance_m", "point_distance_percent"
]
Unit = Literal["frames", "m", "deg", "rad", "s"]
Side = Literal["reference", "estimate"]
MAX_PAIRS = 50_000_000
BLOCK = 8192


@dataclass(frozen=True)
class PairInterval:
    """The pair interval (delta) of a relative error.

    `tolerance`: relative deviation of an interval from delta (used with all pairs, and with seconds); `pairs_from`:
    whose path or rotation is measured, the reference's (ours) or the estimate's (evo's default).
    """

    delta: float = 1.0
    unit: Unit = "frames"
    all_pairs: bool = False
    pairs_from: Side = "reference"
    tolerance: float = 0.1

    def __post_init__(self) -> None:
        refuse_other("unit", self.unit, Unit)
        refuse_other("pairs_from", self.pairs_from, Side)
        if not 0 < self.delta < np.inf:
            raise UserError(f"delta = {self.delta}: must be positive")
        if self.unit == "frames" and self.delta != int(self.delta):
            raise UserError(f"delta = {self.delta:g} frames: must be a whole number of frames")
        if not 0 <= self.tolerance < 1:
            raise UserError(f"tolerance = {self.tolerance}: must lie in 0 .. 1")


class RowPairs(NamedTuple):
    """First and last rows (k,) of intervals."""

    first: Indices
    last: Indices


def interval_pairs(pairs: PosePairs, over: PairInterval) -> RowPairs:
    """First and last rows of every interval; both empty when the trajectory is too short for one."""
    if over.unit == "frames":
        step = int(over.delta)
        ends = np.arange(0, len(pairs), 1 if over.all_pairs else step)
        return RowPairs(ends[ends + step < len(pairs)], ends[ends + step < len(pairs)] + step)
    if over.unit == "s":
        seconds = (pairs.stamps_ns - pairs.stamps_ns[0]) / NS
        i, j = _nearest_ends(seconds, over.delta, over.tolerance)
        inside = seconds[i] + over.delta <= seconds[-1] + 1e-9
        i, j = i[inside], j[inside]
        return RowPairs(i, j) if over.all_pairs else _chain(i, j)
    q = pairs.reference_q if over.pairs_from == "reference" else pairs.estimate_q
    if over.unit == "m":
        p = pairs.reference_m if over.pairs_from == "reference" else pairs.estimate_m
        steps = np.sqrt((np.diff(p, axis=0) ** 2).sum(axis=1))
        if over.all_pairs:
            return _nearest_ends(np.concatenate([[0.0], np.cumsum(steps)]), over.delta, over.tolerance)
        return _accumulate(steps, over.delta)
    delta = np.radians(over.delta) if over.unit == "deg" else over.delta
    if over.all_pairs:
        return _turned_between(q, delta, over.tolerance * delta)
    return _accumulate(angle(between(q[:-1], q[1:])), delta)


class MotionErrors(NamedTuple):
    """Errors of relative motions: quaternions (k, 4), translations (k, 3) in m."""

    quaternions: Array
    translations_m: Array


def relative_motion_errors(pairs: PosePairs, i: Indices, j: Indices) -> MotionErrors:
    """E of the pairs i -> j as quaternions (k, 4), and the translations (k, 3) in metres of R_Q E, R_Q that of Q.

    The norms of these translations are those of E itself.
    """
    p_i, q_i, r_i, s_i = pairs.reference_q[i], pairs.estimate_q[i], pairs.reference_m[i], pairs.estimate_m[i]
    true_p, estimated_p = rotate_back(p_i, pairs.reference_m[j] - r_i), rotate_back(q_i, pairs.estimate_m[j] - s_i)
    true_q, estimated_q = between(p_i, pairs.reference_q[j]), between(q_i, pairs.estimate_q[j])
    return MotionErrors(between(estimated_q, true_q), true_p - estimated_p)


def motion_error_sizes(pairs: PosePairs, i: Indices, j: Indices) -> ErrorSizes:
    """Sizes of E of the pairs i -> j: translation (k,) in m, rotation (k,) in rad; in blocks that fit a cache."""
    metres, radians = np.empty(len(i)), np.empty(len(i))
    for start in range(0, len(i), BLOCK):
        block = slice(start, start + BLOCK)
        q, t = relative_motion_errors(pairs, i[block], j[block])
        metres[block], radians[block] = norm(t), angle(q)
    return ErrorSizes(metres, radians)


def relative_errors(pairs: PosePairs, i: Indices, j: Indices, relation: RpeRelation) -> Array:
    """Errors (k,) of the pairs i -> j.

    The point distances compare straight-line distances: in m, and in percent of the true one
    (pairs in which the ground truth does not move have none and are left out).
    """
    if relation in ("point_distance_m", "point_distance_percent"):
        true = norm(pairs.reference_m[j] - pairs.reference_m[i])
        error = np.abs(true - norm(pairs.estimate_m[j] - pairs.estimate_m[i]))
        return error if relation == "point_distance_m" else 100.0 * error[true > 0] / true[true > 0]
    q, t = relative_motion_errors(pairs, i, j)
    if relation == "translation_m":
        return norm(t)
    if relation == "angle_rad":
        return angle(q)
    if relation == "angle_deg":
        return np.degrees(angle(q))
    if relation == "rotation":
        return chord(q)
    return np.hypot(chord(q), norm(t))


def _nearest_ends(along: Array, delta: float, tolerance: float) -> RowPairs:
    """For each start the later row whose place along is nearest to start + delta, within tolerance * delta."""
    start = np.arange(len(along))
    goal = along + delta
    right = np.minimum(np.searchsorted(along, goal), len(along) - 1)
    left = np.maximum(right - 1, 0)
    end = np.where(np.abs(along[left] - goal) <= np.abs(along[right] - goal), left, right)
    keep = (end > start) & (np.abs(along[end] - goal) <= tolerance * delta)
    return RowPairs(start[keep], end[keep])


def _accumulate(steps: Array, delta: float) -> RowPairs:
    """Consecutive intervals, each ending at the first row where its steps sum to delta or more."""
    ends, total = [0], 0.0
    for row, step in enumerate(steps.tolist(), start=1):
        total += step
        if total >= delta:
            ends.append(row)
            total = 0.0
    rows = np.array(ends, dtype=np.int64)
    return RowPairs(rows[:-1], rows[1:])


def _chain(i: Indices, j: Indices) -> RowPairs:
    """Those of the pairs, sorted by their start, that do not overlap: the first, the first after it, ..."""
    chosen, free = [], 0
    for row, (start, end) in enumerate(zip(i.tolist(), j.tolist(), strict=True)):
        if start >= free:
            chosen.append(row)
            free = end
    return RowPairs(i[chosen], j[chosen])


def _turned_between(q: Array, delta: float, tolerance: float) -> RowPairs:
    """All pairs i < j whose rotations differ by delta +- tolerance (rad)."""
    starts, ends, count = [], [], 0
    for i in range(len(q) - 1):
        turned = angle(between(q[i : i + 1], q[i + 1 :]))
        j = np.flatnonzero((turned >= delta - tolerance) & (turned <= delta + tolerance)) + i + 1
        count += len(j)
        if count > MAX_PAIRS:
            raise UserError(f"more than {MAX_PAIRS} pairs rotate by this angle; use consecutive pairs")
        starts.append(np.full(len(j), i))
        ends.append(j)
    empty = [np.empty(0, np.int64)]
    return RowPairs(np.concatenate(empty + starts), np.concatenate(empty + ends))
