"""Plausibility of trajectories: units, order of quaternions, direction and axes of poses, poses that nobody measured.

The latter are those of motion capture that lost its markers, and of trackers that are lost.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from uavbench.reports.evaluation.gaps import usual_step_ns
from uavbench.reports.metrics.align import Alignment
from uavbench.reports.metrics.association import PosePairs
from uavbench.reports.metrics.quaternions import between, conjugate
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

ALIKE = 0.2
"""Relative tolerance within which a ratio counts as a power of ten, which suggests another unit."""
SAME_WAY = 0.9
"""Correlation of the distances from the centroid above which two paths count as having the same shape."""
CLOSE_RAD = np.radians(10.0)
"""Median rotation error in rad below which the quaternion order is not doubted."""
LEAST_PAIRS = 3
"""Fewest pairs whose lengths and rotations are doubted."""
IDENTITY = np.array([[1.0, 0.0, 0.0, 0.0]])
STILL_RAD, CONSTANT = np.radians(1.0), 0.1
"""Median turn since the first pose below which any rotation is constant; spread of a constant one in such turns."""
STAMP_FACTORS, LENGTH_FACTORS = (1e3, 1e6, 1e9), (1e2, 1e3)
"""Factors of other units: milli-, micro- and nanoseconds; centimetres and millimetres."""
SLOWEST_NS, FASTEST_NS = 10**10, 10**5
"""Usual steps in ns between the poses of both files from which on, and up to which, stamps may be in another unit: no
camera, motion capture or tracker gives a pose every 10 s or every 0.1 ms."""
SECOND_NS, LASTS = 10**9, 2.0
"""Step of the numbers of frames that were taken for stamps, and how much longer than the other file they last."""
REPEATED, MOVED = 5, 5.0
"""Equal poses of the ground truth in a row from which on motion capture may have lost its markers, if the estimate has
moved meanwhile, in medians of its steps."""
MARKERS_LOST = "did motion capture lose its markers"
OTHERWISE: Mapping[str, Callable[[Array], Array]] = {
    "its quaternions were read w first": lambda q: q[:, [1, 2, 3, 0]],
    "its quaternions were read w last": lambda q: q[:, [3, 0, 1, 2]],
    "its poses were inverted": conjugate,
}
"""Other readings of quaternions wxyz (n, 4): of another order, or of poses that map from the world."""
Z_DOWN: Mapping[str, Callable[[Array], Array]] = {
    "world and moving axes of one file had z down (NED, FRD)": lambda q: q * [1, 1, -1, -1]
}
"""Quaternions wxyz (n, 4) with all axes turned by 180 degrees about x."""
SCALED: tuple[Alignment, ...] = ("sim3", "scale", "origin-scale")
"""Alignments that estimate the scale."""


def doubts(reference: Trajectory, estimate: Trajectory, pairs: PosePairs, align: Alignment) -> Iterator[str]:
    """A sentence for each likely mistake in units, in the order of quaternion components, or in the poses' direction.

    pairs: matched poses before alignment.
    """
    yield from doubts_of_stamps(reference, estimate)
    yield from doubts_of_origin("reference", reference, MARKERS_LOST)
    yield from doubts_of_origin("estimate", estimate, "does it say so where it is lost")
    yield from _doubts_of_capture(pairs)
    turned = [*doubts_of_order(pairs, align)] or doubts_of_axes(pairs, align)
    for doubt in (*_doubts_of_length(pairs, align), *turned):
        yield f"{doubt.finding}: {doubt.question}"


class Doubt(NamedTuple):
    """What a likely mistake shows, and what to ask the user about it."""

    finding: str
    question: str


def _doubts_of_length(pairs: PosePairs, align: Alignment) -> Iterator[Doubt]:
    """The unit of length, if positions along a path of the same shape suggest another one."""
    if len(pairs) < LEAST_PAIRS:
        return
    near, far = _from_middle(pairs.estimate_m), _from_middle(pairs.reference_m)
    factor = unit_factor(float(np.sqrt(np.mean(near**2))), float(np.sqrt(np.mean(far**2))), LENGTH_FACTORS)
    if factor and align not in SCALED and np.corrcoef(near, far)[0, 1] > SAME_WAY:
        yield Doubt(
            f"the positions of the estimate spread {times_told(factor)} those of the reference", "are both in metres?"
        )


def doubts_of_order(pairs: PosePairs, align: Alignment) -> Iterator[Doubt]:
    """Order of quaternion components and direction of the poses, if the rotations would fit with others."""
    if len(pairs) < LEAST_PAIRS:
        return
    e, r = pairs.estimate_q, pairs.reference_q
    if found := (align == "none" and _fitting(e, r, lambda q: q, {**OTHERWISE, **Z_DOWN})) or _fitting(
        e, r, _since_first, OTHERWISE
    ):
        yield Doubt(
            f"the rotations of the estimate would fit if {' or if '.join(found)}",
            "are order and direction (to the world) right, also those of the reference?",
        )


def doubts_of_axes(pairs: PosePairs, align: Alignment) -> Iterator[Doubt]:
    """Axes of the moving frame or of the world, if all rotations are turned alike; none after an alignment."""
    if len(pairs) < LEAST_PAIRS or align != "none":
        return
    e, r = pairs.estimate_q, pairs.reference_q
    if angle_deg := turned_deg(e, r):
        yield Doubt(
            f"the rotations of the estimate are those of the reference, turned by the same {angle_deg:.0f} degrees in "
            "all poses",
            "are the axes of the camera, body or world others, or is a --mount inverted?",
        )
    elif angle_deg := turned_deg(conjugate(e), conjugate(r)):
        yield Doubt(
            f"the rotations of the estimate are those of the reference in a world turned by {angle_deg:.0f} degrees",
            "are the axes of one world others, as y up? Turn them, or give --align",
        )


def doubts_of_stamps(reference: Trajectory, estimate: Trajectory) -> Iterator[str]:
    """A sentence where the stamps of one trajectory are likely to be in another unit than those of the other."""
    if not (len(reference) and len(estimate)):
        return
    ours, theirs = (float(each.stamps_ns[-1] - each.stamps_ns[0]) for each in (estimate, reference))
    if factor := unit_factor(ours, theirs, STAMP_FACTORS):
        yield (
            f"the stamps of the estimate span {times_told(factor)} those of the reference: are both in the unit of "
            "their format (TUM: seconds, EuRoC: nanoseconds)?"
        )
        return
    steps_ns = [usual_step_ns(each.stamps_ns) for each in (reference, estimate)]
    if max(steps_ns) <= FASTEST_NS or SLOWEST_NS <= min(steps_ns) < np.inf:
        yield (
            f"the poses of the reference are {steps_ns[0] / SECOND_NS:.2g} s apart, those of the estimate "
            f"{steps_ns[1] / SECOND_NS:.2g} s: are the stamps of both in another unit than that of their format (TUM: "
            "seconds, EuRoC: nanoseconds)? Pairs and times in seconds are then wrong"
        )
    for whose, counted, other in (("estimate", estimate, theirs), ("reference", reference, ours)):
        steps = np.diff(counted.stamps_ns)
        if len(steps) > 1 and (steps == SECOND_NS).all() and float(steps.sum()) > LASTS * other > 0:
            yield (
                f"the stamps of the {whose} are a second apart, {steps.sum() / SECOND_NS:.0f} s in all, and the other "
                f"trajectory lasts {other / SECOND_NS:.3g} s: are they numbers of frames? Write their times"
            )


def doubts_of_origin(whose: str, trajectory: Trajectory, cause: str) -> Iterator[str]:
    """A sentence where a trajectory falls back to its origin, as files do in which a lost pose is the identity."""
    lost = (trajectory.positions_m == 0).all(axis=1)
    falls = np.flatnonzero(lost[1:] & ~lost[:-1]) + 1
    if len(falls):
        yield (
            f"the {whose} is at 0, 0, 0 in {lost.sum()} of {len(trajectory)} poses, and elsewhere before, as at "
            f"{trajectory.stamps_ns[falls[0]] / SECOND_NS:.3f} s: {cause}? Remove these rows"
        )


def _doubts_of_capture(pairs: PosePairs) -> Iterator[str]:
    """A sentence where the reference stays at one pose to the last digit, as of motion capture that sees no markers."""
    poses = np.hstack([pairs.reference_m, pairs.reference_q])
    starts = np.r_[0, np.flatnonzero((poses[1:] != poses[:-1]).any(axis=1)) + 1]
    ends = np.r_[starts[1:], len(pairs)]
    steps_m = np.linalg.norm(np.diff(pairs.estimate_m, axis=0), axis=1)
    moved_m = MOVED * float(np.median(steps_m)) if len(steps_m) else 0.0
    held = [
        slice(start, end)
        for start, end in zip(starts, ends, strict=True)
        if end - start > REPEATED and _reach(pairs.estimate_m[start:end]) > moved_m
    ]
    if held and len(starts) > 1:
        count, first_s = sum(run.stop - run.start for run in held), pairs.stamps_ns[held[0].start] / SECOND_NS
        yield (
            f"the reference stays at one pose, to the last digit, in {count} of {len(pairs)} matched poses, while the "
            f"estimate moves, as from {first_s:.3f} s on: {MARKERS_LOST}? Remove these rows"
        )


def _reach(positions_m: Array) -> float:
    """Largest distance from the first of positions (n, 3)."""
    return float(np.linalg.norm(positions_m - positions_m[0], axis=1).max())


def turned_deg(estimate_q: Array, reference_q: Array) -> float:
    """Angle in degrees of the one rotation of moving axes between rotations (n, 4); 0 if small, or if there is none.

    Of inverse rotations it is that of the fixed axes.
    """
    turns, motion_rad = between(reference_q, estimate_q), _angle(_since_first(reference_q), IDENTITY)
    off_rad, spread_rad = _angle(turns, IDENTITY), _angle(_since_first(turns), IDENTITY)
    turned = off_rad > CLOSE_RAD and motion_rad > STILL_RAD and spread_rad < CONSTANT * motion_rad
    return float(np.degrees(off_rad)) if turned else 0.0


def _fitting(
    estimate_q: Array,
    reference_q: Array,
    of: Callable[[Array], Array],
    readings: Mapping[str, Callable[[Array], Array]],
) -> list[str]:
    """The other readings by which what `of` gives of the rotations would fit.

    The world of the estimate may be another one before an alignment; rotations since the first pose fit all the same.
    """
    given = _angle(of(estimate_q), of(reference_q))
    return [
        what
        for what, otherwise in readings.items()
        if given > CLOSE_RAD and _angle(of(otherwise(estimate_q)), of(reference_q)) < 0.1 * given
    ]


def _since_first(q: Array) -> Array:
    """Rotations (n, 4) since the first."""
    return between(np.broadcast_to(q[:1], q.shape), q)


def unit_factor(value: float, other: float, factors: tuple[float, ...]) -> float:
    """The factor, or its inverse, that a ratio is close to; 0 if it is close to none."""
    if not (value > 0 and other > 0):
        return 0.0
    both = (*factors, *(1 / factor for factor in factors))
    return next((factor for factor in both if abs(np.log(value / other / factor)) < ALIKE), 0.0)


def times_told(factor: float) -> str:
    """`1,000 times`, or `1 / 1,000 of`."""
    return f"{factor:,.0f} times" if factor > 1 else f"1 / {1 / factor:,.0f} of"


def _from_middle(positions_m: Array) -> Array:
    return np.asarray(np.linalg.norm(positions_m - positions_m.mean(axis=0), axis=1))


def _angle(q: Array, other: Array) -> float:
    """Median angle in rad between rotations (n, 4) or (1, 4)."""
    w = np.abs((q * other).sum(axis=1))  # the real part of conj(q) other
    return float(np.median(2 * np.arccos(np.clip(w, 0.0, 1.0))))
