"""A pose fitted to an image, how well the image supports it, and the residuals that it leaves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.measurements import ControlPoints
from uavbench.tracker.robust.solver.bias_kernels import EdgeOffsets, FrameSums
from uavbench.tracker.robust.solver.solve_kernels import Step, Weighting
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FitResiduals:
    """What a fit was made of, for the appearance and the biases to be learned from.

    points and patches (rows `chosen`, with their correlation (m,)), the weighting of both; the offsets of the edges in
    view, the sums over a frame and the last step; prior_information (6, 6) of the prediction; candidates_px (n, k) on
    the search lines, from their middle, inf where none.
    """

    points: ControlPoints
    chosen: Indices
    correlation: Array
    weighting: Weighting
    edges: EdgeOffsets
    sums: FrameSums
    step: Step
    prior_information: Array
    candidates_px: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose with its covariance (6, 6), and how well the image supports it.

    support in [0, 1]: weighted inlier ratio of the control points and patches, edge_support that of the control points
    alone; found: weight of all inliers; range_m: depth of a control point amid the others, nan where there is none.
    """

    cam_from_world: Pose
    covariance: Array
    support: float
    control_points: int
    candidates: int
    inliers: int
    range_m: float
    edge_support: float = 0.0
    found: float = 0.0
    residuals: FitResiduals | None = None

    @property
    def finite(self) -> bool:
        """Whether pose and covariance are numbers."""
        return bool(np.isfinite(self.cam_from_world.matrix).all() and np.isfinite(self.covariance).all())
