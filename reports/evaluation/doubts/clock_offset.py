"""Whether one offset between the clocks of two trajectories explains their errors."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.options import Options
from uavbench.reports.metrics.align import align
from uavbench.reports.metrics.ape import pose_error_sizes
from uavbench.reports.metrics.association import NS, PosePairs
from uavbench.reports.metrics.quaternions import normalized
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

COARSE_S: Array = np.linspace(-30, 30, 301)
FINE_S, MINIMA = (0.02, 2e-3), 5
"""Offsets in s that are tried, and the steps in which the best of them are refined, and how many."""
LEAST_S = 3e-3
"""Offset in s below which it may be one of rounded stamps."""
BETTER = 0.4
"""Errors of position with an offset, as a share of those without, below which it is told."""
ALIKE = 1.1
"""Errors up to this many times the least are as good: the smallest such offset counts, as on a path flown twice."""
POSES, LEAST_POSES, SHARE = 300, 20, 0.5
"""Most poses that are compared, the fewest, and the share of them that must have a reference with an offset too."""
GAP = 5.0
"""Steps of the reference of more than this many medians are not interpolated over."""
WORSE_RAD = np.radians(0.1)
"""Rise of the errors of rotation that counts as none."""


@dataclass(frozen=True, eq=False)
class Compared:
    """The poses of an estimate in `rows` and the reference, with the options of their evaluation."""

    reference: Trajectory
    estimate: Trajectory
    rows: NDArray[np.int64]
    options: Options


def doubts_of_offset(of: Compared, stamped: bool) -> Iterator[str]:
    """A sentence where positions fit far better once the stamps of the estimate are shifted by one offset.

    Errors that a constant offset of position would explain as well, or that come with worse rotations, as those of
    another point of the vehicle do, are not put down to the clocks. stamped: False where poses are paired by rows.
    """
    if min(len(of.rows), len(of.reference)) < LEAST_POSES:
        return
    search = _Search(of)
    by_s = search.best()
    after, before = search.errors(by_s).offsets_m, search.still.offsets_m
    fit = f"the positions of the estimate would fit to {_cm(after)} in place of {_cm(before)}"
    if by_s and stamped:
        yield (
            f"{fit} with {by_s:+.3f} s added to its stamps: do the clocks of the two differ? If so, give --t-offset "
            f"{of.options.offset_s + by_s:.3f}; if the estimate is late, this is its error"
        )
    elif shift := round(by_s / search.step_s):
        yield f"{fit} if its rows were paired with those {shift:+d} on: do both files begin with the same frame?"


class _Errors(NamedTuple):
    """Offsets of position (n, 3) in m, NaN where the reference has no pose, and the rms error of rotation in rad."""

    offsets_m: Array
    rotation_rad: float


class _Search:
    """Errors of an estimate as they would be with other stamps."""

    def __init__(self, of: Compared) -> None:
        chosen = np.linspace(0, len(of.rows) - 1, min(len(of.rows), POSES)).astype(np.int64)
        self.of, self.rows = of, of.rows[chosen]
        self.stamps_s = of.estimate.stamps_ns[self.rows] / NS + of.options.offset_s
        self.table_s = of.reference.stamps_ns / NS
        steps_s = np.diff(self.table_s)
        self.step_s = float(np.median(steps_s))
        self.dense = np.r_[False, steps_s <= GAP * self.step_s, False]

    @cached_property
    def still(self) -> _Errors:
        """Errors with the stamps as they are."""
        return self.errors(0.0)

    def best(self) -> float:
        """Offset in s with the least errors of position, of those that do not make rotations worse; 0 if none is told.

        The smallest one counts where several are as good.
        """
        coarse = self.ratios(COARSE_S)
        around = np.pad(coarse, 1, constant_values=np.inf)
        least = np.flatnonzero((coarse < 1) & (coarse <= around[:-2]) & (coarse <= around[2:]))
        least = least[np.argsort(coarse[least])][:MINIMA]
        refined_s = [self._refined(offset_s) for offset_s in (0.0, *COARSE_S[least].tolist())]
        allowed_rad = self.still.rotation_rad + WORSE_RAD
        found_s = np.array([s for s in refined_s if self.errors(s).rotation_rad <= allowed_rad and abs(s) >= LEAST_S])
        ratios = self.ratios(found_s)
        if not (ratios < BETTER).any():
            return 0.0
        alike = found_s[ratios <= ALIKE * ratios.min()]
        return float(alike[np.argmin(np.abs(alike))])

    def _refined(self, offset_s: float) -> float:
        for step_s in FINE_S:
            tried = offset_s + np.linspace(-10, 10, 21) * step_s
            offset_s = float(tried[np.argmin(self.ratios(tried))])
        return offset_s

    def ratios(self, offsets_s: Array) -> Array:
        """`ratio` of offsets (n,) in s."""
        return np.array([self.ratio(float(offset_s)) for offset_s in offsets_s])

    def ratio(self, by_s: float) -> float:
        """Errors of position with stamps shifted by by_s, over how much those without vary; inf where unknown."""
        moved_m, still_m = self.errors(by_s).offsets_m, self.still.offsets_m
        both = np.isfinite(moved_m[:, 0]) & np.isfinite(still_m[:, 0])
        if both.sum() < max(LEAST_POSES, SHARE * len(self.rows)):
            return np.inf
        varies = float((still_m[both] - still_m[both].mean(axis=0)).std())
        return float(np.sqrt((moved_m[both] ** 2).mean())) / varies if varies > 0 else np.inf

    def errors(self, by_s: float) -> _Errors:
        """Errors after the alignment, with stamps shifted by by_s."""
        stamps_s = self.stamps_s + by_s
        right = np.searchsorted(self.table_s, stamps_s)
        known = self.dense[right]
        offsets_m = np.full((len(stamps_s), 3), np.nan)
        if not known.any():
            return _Errors(offsets_m, np.inf)
        given = self._pairs(stamps_s[known], right[known], known)
        try:
            pairs = align(given, self.of.options.align)
        except UserError:
            return _Errors(offsets_m, np.inf)
        offsets_m[known] = pairs.estimate_m - pairs.reference_m
        return _Errors(offsets_m, float(np.sqrt((pose_error_sizes(pairs).radians ** 2).mean())))

    def _pairs(self, stamps_s: Array, right: NDArray[np.int64], known: NDArray[np.bool_]) -> PosePairs:
        """The reference, interpolated before its rows `right`, and the estimate in those of `rows` that are known."""
        true, given, left = self.of.reference, self.of.estimate, right - 1
        w = ((stamps_s - self.table_s[left]) / (self.table_s[right] - self.table_s[left]))[:, None]
        p, q, rows = true.positions_m, true.quaternions_wxyz, self.rows[known]
        near = np.where((q[left] * q[right]).sum(axis=1, keepdims=True) < 0, -q[right], q[right])
        return PosePairs(
            given.stamps_ns[rows],
            p[left] + w * (p[right] - p[left]),
            normalized(q[left] + w * (near - q[left])),
            given.positions_m[rows],
            normalized(given.quaternions_wxyz[rows]),
        )


def _cm(offsets_m: Array) -> str:
    """Rms length of offsets (n, 3)."""
    known = offsets_m[np.isfinite(offsets_m[:, 0])]
    return f"{100 * np.sqrt((known**2).sum(axis=1).mean()):.3g} cm"
