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

    step_s: usual step between its poses; infinite for fewer than two.
    """

    at_s: Array
    sizes: Array
    step_s: float

    @classmethod
    def of(cls, sizes: Array, stamps_ns: NDArray[np.int64], *rows: Indices) -> "TimedErrors":
        """Errors of sizes (n,) and of the poses in rows (n,) at stamps (m,): one of each, or both of an interval."""
        times_s = stamps_ns / NS
        return cls(np.column_stack([times_s[each] for each in rows]), sizes, usual_step_ns(stamps_ns) / NS)

    def near(self, other: "TimedErrors") -> NDArray[np.bool_]:
        """Whether another run has an error at these times (n,): nearer than half the shorter of both usual steps."""
        if np.array_equal(self.at_s, other.at_s):
            return np.ones(len(self.at_s), dtype=bool)
        if not len(other.at_s):
            return np.zeros(len(self.at_s), dtype=bool)
        from scipy.spatial import cKDTree  # lazy: most runs have the same frames

        distance_s, _ = cKDTree(other.at_s).query(self.at_s, p=np.inf)
        return np.asarray(distance_s < 0.5 * min(self.step_s, other.step_s))


def in_common(runs: ListOf[TimedErrors]) -> list[NDArray[np.bool_]]:
    """Which errors (n,) of each run are of frames that all runs have."""
    return [np.logical_and.reduce([run.near(other) for other in runs]) for run in runs]
