"""Errors of runs over the frames that all of them have: a run that is lost where it is difficult is not better."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.evaluation.gaps import usual_step_ns
from uavbench.reports.metrics.association import NS, Indices
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, eq=False)
class TimedErrors:
    """Sizes (n,) of the errors of a run, m or deg, and the times at_s (n, k) of their poses: one, or two for RPE.

    poses_s (m,): times of all its poses; step_s: usual step between these, infinite for fewer than two. alike: whether
    another run needs the same interval, not only poses at its ends, as where intervals are counted in frames.
    """

    at_s: Array
    sizes: Array
    poses_s: Array
    step_s: float
    alike: bool

    @classmethod
    def of(cls, sizes: Array, stamps_ns: NDArray[np.int64], *rows: Indices, alike: bool = True) -> "TimedErrors":
        """Errors of sizes (n,) and of the poses in rows (n,) at stamps (m,): one of each, or both of an interval."""
        poses_s = stamps_ns / NS
        at_s = np.column_stack([poses_s[each] for each in rows])
        return cls(at_s, sizes, poses_s, usual_step_ns(stamps_ns) / NS, alike)

    def near(self, other: "TimedErrors") -> NDArray[np.bool_]:
        """Whether another run has these errors (n,), too.

        It has them where it has an error nearer than half the shorter of both usual steps; or, of an interval in
        seconds, metres or degrees, poses nearer to its ends than half the longer one.
        """
        if np.array_equal(self.at_s, other.at_s):
            return np.ones(len(self.at_s), dtype=bool)
        if self.alike:
            return _within(0.5 * min(self.step_s, other.step_s), self.at_s, other.at_s)
        limit_s = 0.5 * max(self.step_s, other.step_s)
        ends = [_within(limit_s, end[:, None], other.poses_s[:, None]) for end in self.at_s.T]
        return np.asarray(np.logical_and.reduce(ends))


def in_common(runs: ListOf[TimedErrors]) -> list[NDArray[np.bool_]]:
    """Which errors (n,) of each run are of frames that all runs have."""
    return [np.logical_and.reduce([run.near(other) for other in runs]) for run in runs]


def _within(limit_s: float, times_s: Array, others_s: Array) -> NDArray[np.bool_]:
    """Whether one of other times (m, k) is nearer than a limit to each of these (n, k), in every component."""
    if not len(others_s):
        return np.zeros(len(times_s), dtype=bool)
    from scipy.spatial import cKDTree  # lazy: most runs have the same frames

    distance_s, _ = cKDTree(others_s).query(times_s, p=np.inf)
    return np.asarray(distance_s < limit_s)
