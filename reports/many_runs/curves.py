"""Errors of a run over time and over distance travelled, in equal bins, and their bands over runs."""

from collections.abc import Sequence as ListOf
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.association import NS
from uavbench.reports.metrics.sub_trajectories import distance_along
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import Trajectory

BINS = 200
"""Most bins over time or distance; a figure 3.5 in wide resolves no more."""
BAND = (0.05, 0.95)
"""Quantiles of the runs at the lower and the upper border of a band."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Time (s) or distance (m) along the ground truth: edges (b + 1,) of its bins, and values (n,) at stamps (n,)."""

    edges: Array
    stamps_ns: NDArray[np.int64]
    values: Array

    @property
    def middles(self) -> Array:
        """Centres (b,) of the bins."""
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    def binned(self, stamps_ns: NDArray[np.int64], errors: Array) -> Array:
        """Root mean square (b,) of errors (n,) at stamps (n,) in ns; NaN in an empty bin."""
        along = np.interp((stamps_ns - self.stamps_ns[0]) / NS, (self.stamps_ns - self.stamps_ns[0]) / NS, self.values)
        bins = len(self.edges) - 1
        width = self.edges[-1] - self.edges[0]
        place = np.zeros(len(along), dtype=np.int64)
        if width > 0:
            place = np.minimum((bins * (along - self.edges[0]) / width).astype(np.int64), bins - 1)
        count = np.bincount(place, minlength=bins)
        total = np.bincount(place, weights=errors**2, minlength=bins)
        return np.asarray(np.sqrt(np.divide(total, count, out=np.full(bins, np.nan), where=count > 0)))


def time_axis(truth: Trajectory) -> Axis:
    """Axis of the time in s since the first pose of the ground truth."""
    seconds = (truth.stamps_ns - truth.stamps_ns[0]) / NS
    return Axis(np.linspace(0.0, seconds[-1], _bins(truth) + 1), truth.stamps_ns, seconds)


def distance_axis(truth: Trajectory) -> Axis:
    """Axis of the distance travelled in m along the ground truth."""
    metres = distance_along(truth.positions_m)
    return Axis(np.linspace(0.0, metres[-1], _bins(truth) + 1), truth.stamps_ns, metres)


def _bins(truth: Trajectory) -> int:
    return max(1, min(BINS, len(truth) // 2))


@dataclass(frozen=True, eq=False)
class Band:
    """Median (b,) over runs, and the borders (b,) of their central 90 %; NaN where no run has a pose."""

    low: Array
    middle: Array
    high: Array

    @classmethod
    def of(cls, curves: ListOf[Array]) -> "Band":
        """Band over the curves (b,) of one run or more."""
        table = np.array(curves)
        known = ~np.isnan(table).all(axis=0)
        out = np.full((3, table.shape[1]), np.nan)
        if known.any():
            out[:, known] = np.nanquantile(table[:, known], [BAND[0], 0.5, BAND[1]], axis=0)
        return cls(*out)
