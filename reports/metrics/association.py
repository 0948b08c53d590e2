"""Association of estimated poses with reference poses by their stamps.

Conventions: stamps are integer nanoseconds; an offset is added to the stamps of the estimate; a pair may differ by
`max_difference_s` at most, the limit included. Differences are taken between float64 seconds, as the TUM tools and evo
do: a stamp halfway between two others is matched in the same way.
"""

import heapq
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.quaternions import normalized, slerp
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

Association = Literal["one-to-one", "evo", "evo-interpolated"]
Indices = NDArray[np.int64]
NS = 1_000_000_000
DEFAULT_MAX_DIFFERENCE_S = 0.01


@dataclass(frozen=True, eq=False)
class PosePairs:
    """Matched poses of a reference and an estimate, in the order of their stamps.

    stamps_ns (n,) of the reference; *_m (n, 3) positions in metres; *_q (n, 4) unit quaternions wxyz. Arrays are
    read-only.
    """

    stamps_ns: NDArray[np.int64]
    reference_m: Array
    reference_q: Array
    estimate_m: Array
    estimate_q: Array

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def with_estimate(self, positions_m: Array, quaternions: Array) -> "PosePairs":
        """The same pairs with other estimated poses."""
        return replace(self, estimate_m=positions_m, estimate_q=quaternions)


@dataclass(frozen=True, eq=False)
class Matches:
    """Corresponding rows (n,) of reference and estimate."""

    reference: Indices
    estimate: Indices


def associate(
    reference: Trajectory,
    estimate: Trajectory,
    method: Association = "one-to-one",
    max_difference_s: float = DEFAULT_MAX_DIFFERENCE_S,
    offset_s: float = 0.0,
) -> PosePairs:
    """Pairs of two trajectories, as `match` finds them; `evo-interpolated` interpolates the longer at the shorter."""
    return paired(reference, estimate, match(reference, estimate, method, max_difference_s, offset_s), method, offset_s)


def match(
    reference: Trajectory,
    estimate: Trajectory,
    method: Association = "one-to-one",
    max_difference_s: float = DEFAULT_MAX_DIFFERENCE_S,
    offset_s: float = 0.0,
) -> Matches:
    """Corresponding rows of two trajectories; UserError when no stamps are near enough to each other.

    `one-to-one`: globally nearest first, each pose used once, ties to the earlier. `evo` and `evo-interpolated`: each
    pose of the shorter trajectory (the estimate when equal) is matched to the nearest stamp of the longer, which may be
    used many times.
    """
    if not (max_difference_s >= 0 and abs(offset_s) < np.inf):
        raise UserError(f"max_difference_s = {max_difference_s}, offset_s = {offset_s}: must be finite, the first >= 0")
    if method == "one-to-one":
        a, b = one_to_one(reference.stamps_ns / NS, estimate.stamps_ns / NS + offset_s, max_difference_s)
    else:
        a, b = nearest_to_shorter(reference.stamps_ns, estimate.stamps_ns, max_difference_s, offset_s)
    if not len(a):
        raise UserError(
            f"no stamps of the two trajectories lie within {max_difference_s:g} s of each other: the reference spans "
            f"{_span(reference)}, the estimate {_span(estimate)} (+ offset {offset_s:g} s); "
            "check the offset, the maximum difference and the unit of the stamps"
        )
    return Matches(a, b)


def paired(
    reference: Trajectory,
    estimate: Trajectory,
    rows: Matches,
    method: Association = "one-to-one",
    offset_s: float = 0.0,
) -> PosePairs:
    """Pairs of matched rows; under `evo-interpolated` the longer trajectory is interpolated at the shorter's stamps."""
    a, b = rows.reference, rows.estimate
    pairs = PosePairs(
        reference.stamps_ns[a],
        reference.positions_m[a],
        normalized(reference.quaternions_wxyz[a]),
        estimate.positions_m[b],
        normalized(estimate.quaternions_wxyz[b]),
    )
    if method != "evo-interpolated":
        return pairs
    if len(estimate) <= len(reference):
        stamps = estimate.stamps_ns[b] / NS + offset_s
        p, q = interpolate(reference, reference.stamps_ns / NS, stamps)
        return PosePairs(np.round(stamps * NS).astype(np.int64), p, q, pairs.estimate_m, pairs.estimate_q)
    return pairs.with_estimate(*interpolate(estimate, estimate.stamps_ns / NS + offset_s, pairs.stamps_ns / NS))


class RowPairs(NamedTuple):
    """Rows (k,) of the reference, and the corresponding rows of the estimate."""

    reference: Indices
    estimate: Indices


def nearest_to_shorter(
    reference_ns: Indices, estimate_ns: Indices, max_difference_s: float, offset_s: float = 0.0
) -> RowPairs:
    """Rows of reference and estimate, nearest stamp for each pose of the shorter; many-to-one allowed."""
    estimate_is_short = len(estimate_ns) <= len(reference_ns)
    short, long = (estimate_ns, reference_ns) if estimate_is_short else (reference_ns, estimate_ns)
    if not len(short):
        return RowPairs(np.empty(0, np.int64), np.empty(0, np.int64))
    stamps = short / NS
    table = long / NS + (-offset_s if estimate_is_short else offset_s)
    right = np.minimum(np.searchsorted(table, stamps), len(table) - 1)
    left = np.maximum(right - 1, 0)
    to_left, to_right = np.abs(table[left] - stamps), np.abs(table[right] - stamps)
    nearest = np.where(to_left <= to_right, left, right)
    rows = np.flatnonzero(np.minimum(to_left, to_right) <= max_difference_s)
    return RowPairs(nearest[rows], rows) if estimate_is_short else RowPairs(rows, nearest[rows])


def one_to_one(reference_s: Array, estimate_s: Array, max_difference_s: float) -> RowPairs:
    """Rows of reference and estimate, greedily by (difference, reference row, estimate row), each used once.

    Mutually nearest pairs without a tie are matched first; the few that remain go through a heap.
    """
    a_of, b_of = np.arange(len(reference_s)), np.arange(len(estimate_s))
    done_a, done_b = [], []
    for _ in range(2):
        if not (len(a_of) and len(b_of)):
            break
        rows_a, rows_b = _mutually_nearest(reference_s[a_of], estimate_s[b_of], max_difference_s)
        done_a.append(a_of[rows_a])
        done_b.append(b_of[rows_b])
        a_of, b_of = np.delete(a_of, rows_a), np.delete(b_of, rows_b)
    rest_a, rest_b = _greedy(reference_s[a_of], estimate_s[b_of], max_difference_s)
    a = np.concatenate([*done_a, a_of[rest_a]]).astype(np.int64)
    b = np.concatenate([*done_b, b_of[rest_b]]).astype(np.int64)
    order = np.argsort(a, kind="stable")
    return RowPairs(a[order], b[order])


def _mutually_nearest(a: Array, b: Array, limit: float) -> RowPairs:
    """Rows that are each other's nearest within the limit, strictly nearer than any other."""
    to_b, gap_a = _strictly_nearest(a, b)
    to_a, _ = _strictly_nearest(b, a)
    rows = np.arange(len(a))
    mutual = (to_b >= 0) & (gap_a <= limit)
    mutual[mutual] = to_a[to_b[mutual]] == rows[mutual]
    return RowPairs(rows[mutual], to_b[mutual])


class Nearest(NamedTuple):
    """Row (n,) of the nearest stamp, and the difference (n,) to it."""

    row: Indices
    difference: Array


def _strictly_nearest(a: Array, b: Array) -> Nearest:
    """Row of b nearest to each of a, -1 where two are equally near, and the distance."""
    right = np.searchsorted(b, a)
    left = np.maximum(right - 1, 0)
    right = np.minimum(right, len(b) - 1)
    to_left, to_right = np.abs(a - b[left]), np.abs(b[right] - a)
    nearest = np.where(to_left < to_right, left, right)
    return Nearest(np.where((to_left == to_right) & (left != right), -1, nearest), np.minimum(to_left, to_right))


def _greedy(a: Array, b: Array, limit: float) -> RowPairs:
    """Greedy nearest-first matching: the nearest remaining pair is always adjacent in the merged order."""
    n, m = len(a), len(b)
    if not (n and m):
        return RowPairs(np.empty(0, np.int64), np.empty(0, np.int64))
    stamp = np.concatenate([a, b])
    merged = np.argsort(stamp, kind="stable").tolist()
    stamp_of = stamp.tolist()
    before, after = [-1] * (n + m), [-1] * (n + m)
    for u, v in pairwise(merged):
        after[u], before[v] = v, u
    heap: list[tuple[float, int, int]] = []

    def push(u: int, v: int) -> None:
        if u >= 0 and v >= 0 and (u < n) != (v < n) and abs(stamp_of[u] - stamp_of[v]) <= limit:
            heapq.heappush(heap, (abs(stamp_of[u] - stamp_of[v]), min(u, v), max(u, v)))

    for u, v in pairwise(merged):
        push(u, v)
    used = [False] * (n + m)
    rows_a, rows_b = [], []
    while heap:
        _, i, j = heapq.heappop(heap)
        if used[i] or used[j]:
            continue
        used[i] = used[j] = True
        rows_a.append(i)
        rows_b.append(j - n)
        for k in (i, j):
            u, v = before[k], after[k]
            if u >= 0:
                after[u] = v
            if v >= 0:
                before[v] = u
        first, last = (i, j) if stamp_of[i] <= stamp_of[j] else (j, i)
        push(before[first], after[last])
    return RowPairs(np.array(rows_a, dtype=np.int64), np.array(rows_b, dtype=np.int64))


class Interpolated(NamedTuple):
    """Positions (n, 3) in m, and quaternions wxyz (n, 4)."""

    positions_m: Array
    quaternions_wxyz: Array


def interpolate(trajectory: Trajectory, table_s: Array, stamps_s: Array) -> Interpolated:
    """Positions (linear) and quaternions (slerp) at stamps in seconds, held at both ends."""
    right = np.clip(np.searchsorted(table_s, stamps_s), 1, max(len(table_s) - 1, 1))
    right = np.minimum(right, len(table_s) - 1)
    left = np.maximum(right - 1, 0)
    step = table_s[right] - table_s[left]
    w = np.clip((stamps_s - table_s[left]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
    p = trajectory.positions_m
    q = normalized(trajectory.quaternions_wxyz)
    return Interpolated(p[left] + w[:, None] * (p[right] - p[left]), slerp(q[left], q[right], w))


def _span(trajectory: Trajectory) -> str:
    if not len(trajectory):
        return "nothing"
    return f"{trajectory.stamps_ns[0] / NS:.3f} .. {trajectory.stamps_ns[-1] / NS:.3f} s"
