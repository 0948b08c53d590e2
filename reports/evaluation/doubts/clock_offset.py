"""Whether one offset between the clocks of two trajectories, or another rate of one, explains their errors."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.doubts.other_frames import ROUND_OFF, fitted, world_columns
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
WELL_S, NEAR_S = 0.05, 0.2
"""Motion of the reference, in s, above the errors of position, with which larger offsets than NEAR_S are not sought."""
RATES_HZ, MOST_TIMES = (5, 10, 12, 15, 20, 24, 25, 30, 50, 60, 90, 100, 120), 6
"""Rates of cameras, of which one may have been taken for another, and how many times it may be the other."""
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
    if search.is_exact:
        return
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
    elif stamped and (stretch := search.best_stretch()) != 1:
        yield (
            f"the positions of the estimate would fit to {_cm(search.errors(0.0, stretch).offsets_m)} in place of "
            f"{_cm(before)} if its stamps were {stretch:.4g} times as far from its first one: is it of images of "
            "another rate, as of a --rate-hz that was not theirs?"
        )


class _Errors(NamedTuple):
    """Offsets of position (n, 3) in m, NaN where the reference has no pose, and the rms error of rotation in rad.

    reference_m: positions (n, 3) of the reference, NaN where it has no pose.
    """

    offsets_m: Array
    rotation_rad: float
    reference_m: Array


class _Search:
    """Errors of an estimate as they would be with other stamps."""

    def __init__(self, of: Compared) -> None:
        chosen = np.linspace(0, len(of.rows) - 1, min(len(of.rows), POSES)).astype(np.int64)
        self.of, self.rows = of, of.rows[chosen]
        self.stamps_s = of.estimate.stamps_ns[self.rows] / NS + of.options.offset_s
        self.first_s = of.estimate.stamps_ns[0] / NS + of.options.offset_s
        self.table_s = of.reference.stamps_ns / NS
        steps_s = np.diff(self.table_s)
        self.step_s = float(np.median(steps_s))
        self.dense = np.r_[False, steps_s <= GAP * self.step_s, False]

    @cached_property
    def still(self) -> _Errors:
        """Errors with the stamps as they are."""
        return self.errors(0.0)

    @cached_property
    def is_exact(self) -> bool:
        """Whether errors of position are round-off, of which an offset on a circle has as little after an alignment."""
        known = np.isfinite(self.still.reference_m[:, 0])
        spread_m = _spread(self.still.reference_m[known]) if known.any() else 0.0
        return _rms(self.still.offsets_m) <= ROUND_OFF * spread_m

    @cached_property
    def is_well_timed(self) -> bool:
        """Whether errors of position are smaller than what the reference moves within WELL_S."""
        moved_m = self.errors(NEAR_S).reference_m - self.still.reference_m
        known = np.isfinite(moved_m[:, 0])
        return bool(known.any() and _rms(self.still.offsets_m) < WELL_S / NEAR_S * _rms(moved_m))

    def best(self) -> float:
        """Offset in s with the least errors of position, of those that do not make rotations worse; 0 if none is told.

        The smallest one counts where several are as good.
        """
        coarse = np.full(len(COARSE_S), np.inf) if self.is_well_timed else self.ratios(COARSE_S)
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

    def best_stretch(self) -> float:
        """Factor of the times since the first pose with the least errors of position, 1 if none is told.

        It must explain them far better than another world would, of another scale, too, and not make rotations worse.
        """
        if self.is_well_timed:
            return 1.0
        factors = sorted({a / b for a in RATES_HZ for b in RATES_HZ if a != b and max(a, b) <= MOST_TIMES * min(a, b)})
        allowed_rad = self.still.rotation_rad + WORSE_RAD
        ratios = np.array([self.ratio(0.0, factor) for factor in factors])
        best = int(np.argmin(ratios))
        if not ratios[best] < BETTER or self.errors(0.0, factors[best]).rotation_rad > allowed_rad:
            return 1.0
        known = np.isfinite(self.still.offsets_m[:, 0])
        positions_m = self.of.estimate.positions_m[self.rows[known]]
        left_m = self.errors(0.0, factors[best]).offsets_m
        otherwise_m = fitted(world_columns(positions_m), self.still.offsets_m[known]).rest_m
        return factors[best] if _rms(left_m) < BETTER * _rms(otherwise_m) else 1.0

    def ratios(self, offsets_s: Array) -> Array:
        """`ratio` of offsets (n,) in s."""
        return np.array([self.ratio(float(offset_s)) for offset_s in offsets_s])

    def ratio(self, by_s: float, stretch: float = 1.0) -> float:
        """Errors of position with other stamps, as of `errors`, over how much those without vary; inf where unknown.

        Both are in parts of how far the reference moves meanwhile: where it rests, an alignment shrinks all errors.
        """
        moved, still = self.errors(by_s, stretch), self.still
        moved_m, still_m = moved.offsets_m, still.offsets_m
        both = np.isfinite(moved_m[:, 0]) & np.isfinite(still_m[:, 0])
        if both.sum() < max(LEAST_POSES, SHARE * len(self.rows)):
            return np.inf
        varies = _spread(still_m[both]) * _spread(moved.reference_m[both])
        return _rms(moved_m[both]) * _spread(still.reference_m[both]) / varies if varies > 0 else np.inf

    def errors(self, by_s: float, stretch: float = 1.0) -> _Errors:
        """Errors after the alignment, with stamps stretched from the estimate's first one on, and shifted by by_s."""
        stamps_s = self.first_s + stretch * (self.stamps_s - self.first_s) + by_s
        right = np.searchsorted(self.table_s, stamps_s)
        known = self.dense[right]
        offsets_m = np.full((len(stamps_s), 3), np.nan)
        if not known.any():
            return _Errors(offsets_m, np.inf, offsets_m)
        given = self._pairs(stamps_s[known], right[known], known)
        try:
            pairs = align(given, self.of.options.align)
        except UserError:
            return _Errors(offsets_m, np.inf, offsets_m)
        reference_m = offsets_m.copy()
        offsets_m[known], reference_m[known] = pairs.estimate_m - pairs.reference_m, pairs.reference_m
        return _Errors(offsets_m, float(np.sqrt((pose_error_sizes(pairs).radians ** 2).mean())), reference_m)

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


def _spread(positions_m: Array) -> float:
    """Rms distance of positions (n, 3) from their middle."""
    return _rms(positions_m - positions_m.mean(axis=0))


def _rms(offsets_m: Array) -> float:
    """Rms length of offsets (n, 3) that are known."""
    known = offsets_m[np.isfinite(offsets_m[:, 0])]
    return float(np.sqrt((known**2).sum(axis=1).mean()))


def _cm(offsets_m: Array) -> str:
    """Rms length of offsets (n, 3)."""
    return f"{100 * _rms(offsets_m):.3g} cm"
