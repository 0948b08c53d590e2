"""Whether poses that both files have were left out because their stamps differ by more than the largest difference."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.gaps import LOST_FRAMES, usual_step_ns
from uavbench.reports.evaluation.options import Options
from uavbench.reports.metrics.association import NS, Matches
from uavbench.trajectories.trajectory import Trajectory

MANY = 0.1
"""Share of the poses of the sparser file from which on those that were left out are told."""


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
        most_s = np.ceil(float(away[np.isfinite(away)].max()) / NS * 1e4) / 1e4
        yield (
            f"{count} of {len(few)} poses of the {name} lie between two of the {other} and farther than "
            f"{options.max_difference_s:g} s from both: they were left out, and count as poses that are missing. Give "
            f"--max-diff {most_s:g} to pair them, too"
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
