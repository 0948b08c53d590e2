"""What stamps that differ do to an evaluation: poses that were left out, and motion that counts as error."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.gaps import LOST_FRAMES, usual_step_ns
from uavbench.reports.evaluation.options import Options
from uavbench.reports.metrics.association import NS, Matches
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

MANY = 0.1
"""Share of the poses of the sparser file from which on those that were left out are told."""
STEP_S = 1e-4
"""Step to which the largest difference that is advised is rounded up."""
LEAST_POSES, ANOTHER_RATE = 3, 1.2
"""Fewest frames whose rate is doubted, and ratio of rates from which on they are two."""
LEAST_M, MOSTLY = 1e-5, 0.5
"""Motion between the stamps of pairs, in m and in position errors, from which on it is told."""


def doubts_of_pairing(reference: Trajectory, estimate: Trajectory, rows: Matches, options: Options) -> Iterator[str]:
    """A sentence where many poses of the sparser file lie between two of the other one, and were paired with neither.

    They count against the coverage, as if the estimate had lost them. What lies in a gap of the other file does not.
    """
    ours = estimate.stamps_ns + round(options.offset_s * NS)
    sides = (("reference", reference.stamps_ns, rows.reference), ("estimate", ours, rows.estimate))
    (name, few, used), (other, many, _) = sorted(sides, key=lambda side: -usual_step_ns(side[1]))
    step_ns = usual_step_ns(many)
    left = np.setdiff1d(np.arange(len(few)), used)
    away = _to_nearest(few[left], many, LOST_FRAMES * step_ns)
    count = int(np.isfinite(away).sum())
    if count > MANY * len(few):
        most_s = max(float(away[np.isfinite(away)].max()) / NS, options.max_difference_s) + STEP_S
        yield (
            f"{count} of {len(few)} poses of the {name} lie between two of the {other} and farther than "
            f"{options.max_difference_s:g} s from both: they were left out, and count as poses that are missing. Give "
            f"--max-diff {np.ceil(most_s / STEP_S) * STEP_S:g} --association "
            "evo-interpolated to compare them, too"
        )


def _to_nearest(stamps_ns: NDArray[np.int64], among_ns: NDArray[np.int64], longest_ns: float) -> NDArray[np.float64]:
    """Distance in ns of stamps (k,) from the nearest of others (n,); infinite outside of these, and in their gaps."""
    after = np.searchsorted(among_ns, stamps_ns)
    out = np.full(len(stamps_ns), np.inf)
    inside = (after > 0) & (after < len(among_ns))
    low, high = among_ns[after[inside] - 1], among_ns[after[inside]]
    nearest = np.minimum(stamps_ns[inside] - low, high - stamps_ns[inside])
    out[inside] = np.where(high - low <= longest_ns, nearest, np.inf)
    return out


def doubts_of_motion(
    reference: Trajectory, estimate: Trajectory, rows: Matches, options: Options, error_m: Array
) -> Iterator[str]:
    """A sentence where position errors (n,) are about what the vehicle moves between the two stamps of each pair."""
    if options.association == "evo-interpolated" or len(reference) < 2:
        return
    apart_s = (reference.stamps_ns[rows.reference] - estimate.stamps_ns[rows.estimate]) / NS - options.offset_s
    times_s = (reference.stamps_ns - reference.stamps_ns[0]) / NS
    speed_m_s = np.linalg.norm(np.gradient(reference.positions_m, times_s, axis=0), axis=1)[rows.reference]
    moved_m, rmse_m = (float(np.sqrt(np.mean(each**2))) for each in (apart_s * speed_m_s, error_m))
    if moved_m > LEAST_M and moved_m > MOSTLY * rmse_m:
        yield (
            f"the stamps of paired poses are up to {np.abs(apart_s).max() * 1e3:.2g} ms apart, in which the reference "
            f"moves by {moved_m * 1e3:.2g} mm (rms), and the position error is {rmse_m * 1e3:.2g} mm: it is mostly "
            "this motion. Give --association evo-interpolated, which interpolates the longer file"
        )


class LeftOut(NamedTuple):
    """How many poses of the estimate have no pair: outside the time of the reference, and within it."""

    outside: int
    within: int

    @classmethod
    def of(cls, reference: Trajectory, estimate: Trajectory, rows: Matches, options: Options) -> "LeftOut":
        """Numbers of poses that no row of the reference is paired with."""
        left = np.setdiff1d(np.arange(len(estimate)), rows.estimate)
        ours = estimate.stamps_ns[left] + round(options.offset_s * NS)
        margin_ns = round(options.max_difference_s * NS)
        first, last = int(reference.stamps_ns[0]) - margin_ns, int(reference.stamps_ns[-1]) + margin_ns
        outside = int(np.count_nonzero((ours < first) | (ours > last)))
        return cls(outside, len(left) - outside)

    def __str__(self) -> str:
        parts = {"outside the time of the reference": self.outside, "without a pair": self.within}
        return ", ".join(f"{count} {where}" for where, count in parts.items() if count)


def doubts_of_left_out(left: LeftOut, estimate: Trajectory) -> Iterator[str]:
    """A sentence where many poses of the estimate are outside the time of the reference, as of two runs in one file."""
    if left.outside > MANY * len(estimate):
        yield (
            f"{left.outside} of {len(estimate)} poses of the estimate are outside the time of the reference and were "
            "left out: does the file hold more than one run, or does the reference end early?"
        )


def doubts_of_rate(reference: Trajectory, frames_ns: NDArray[np.int64]) -> Iterator[str]:
    """A sentence where a tracker had as many frames as the reference has poses, but at another rate."""
    steps_ns = [usual_step_ns(each) for each in (reference.stamps_ns, frames_ns)]
    if len(frames_ns) == len(reference) >= LEAST_POSES and max(steps_ns) > ANOTHER_RATE * min(steps_ns):
        rates_hz = [NS / step_ns for step_ns in steps_ns]
        yield (
            f"the estimate is of as many frames as the reference has poses, {len(reference)}, but these are "
            f"{rates_hz[0]:.3g} a second, and its frames {rates_hz[1]:.3g}: were its images tracked with another "
            "--rate-hz than theirs? Poses are then paired with those of other images"
        )
