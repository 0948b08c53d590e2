"""A pose fitted to an image, how well the image supports it, and what it rests on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.solver.bias_kernels import Sums
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a fit rests on.

    Control points with their keys, rows of appearance, residuals and weights; the patches, their weights and
    correlations; the edges in view and the variance of their offsets, the sums over them, the twists from the pose of
    the sums to the patches' pose and to that of the fit; the information (6, 6) of the prediction.
    """

    points: Array
    keys: Indices
    rows: Indices
    residual: Array
    weights: Array
    chosen: Indices
    patch_weights: Array
    found: Array
    edges: Indices
    spread: Array
    sums: Sums
    to_patches: Array
    to_fit: Array
    prior: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose and how well the edges support it.

    covariance (6, 6); support in [0, 1]: weighted share of the control points and patches that were found, and
    edge_support that of the control points alone; found: weight of all that was found, control points
    and patches as much as in the support.
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
    evidence: Evidence | None = None

    @property
    def finite(self) -> bool:
        """Whether pose and covariance are numbers."""
        return bool(np.isfinite(self.cam_from_world.matrix).all() and np.isfinite(self.covariance).all())
