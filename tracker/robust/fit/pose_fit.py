"""A fit: its problem, intermediate results, and the pose with its support and residuals."""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import inverse6
from uavbench.tracker.protocol import Image
from uavbench.tracker.robust.edges.measurements import (
    CONTROL_POINTS,
    EDGE_MEASUREMENTS,
    SEARCH_LINES,
    ControlPoints,
    EdgeMeasurements,
    SearchLines,
)
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.patches.matches import PATCH_MATCHES, PatchMatches
from uavbench.tracker.robust.solver.bias_state import EDGE_OFFSETS, FRAME_SUMS, EdgeOffsets, FrameSums
from uavbench.tracker.robust.solver.equation_kernels import POSE_PRIOR, PosePrior
from uavbench.tracker.robust.solver.solve_kernels import ESTIMATE, STEP, Estimate, Step
from uavbench.tracker.robust.solver.sum_kernels import WEIGHTING, Weighting
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, unchecked
from uavbench.trajectories.pose import Array, Pose

Indices = NDArray[np.int64]
NO_ROWS: Indices = np.zeros(0, dtype=np.int64)
MIN_POINTS = 6
"""Least number of control points or patches for a fit, and of patches that make a wide search of edges unnecessary:
these give two equations each, and thus twice as many as a pose has unknowns."""
NO_MATCHES = PatchMatches(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
CERTAIN = Chance(0.0, 0.0)


class Problem(NamedTuple):
    """An image (h, w, c), the view at the prediction with its covariance (6, 6), and the control points visible there.

    lines are those at the prediction; weight (n,) of each control point in the pose, counts (n,) in its support; edges
    (g,) rows of the edges in view among the offsets; by_numbers (n, r): see `EdgesInView`.
    """

    image: Image
    at: View
    covariance: Array
    prior: PosePrior
    points: ControlPoints
    lines: SearchLines
    weight: Array
    counts: Array
    edges: Indices
    by_numbers: Array


class Aligned(NamedTuple):
    """A view close enough for a short search, and the matches of the patches near it."""

    at: View
    matches: PatchMatches


class Solution(NamedTuple):
    """An estimate, its measurements, and the offsets of the edges in view."""

    estimate: Estimate
    measured: EdgeMeasurements
    edges: EdgeOffsets


class Searched(NamedTuple):
    """A fit to the matches of a search: its problem, alignment and solution; patches: rows of those that were used."""

    problem: Problem
    aligned: Aligned
    found: Solution
    patches: Indices

    def with_covariance(self, covariance: Array) -> "Searched":
        """The same matches, of a prediction with another covariance (6, 6)."""
        problem, before = self.problem, self.problem.prior
        prior = PosePrior(inverse6(covariance), before.R, before.t, before.known)
        problem = Problem(problem.image, problem.at, covariance, prior, *problem[4:])
        return Searched(problem, self.aligned, self.found, self.patches)


@compiled("f2 f1 f2")
def are_finite(R: Array, t: Array, covariance: Array) -> bool:
    """Whether a pose (R, t) and its covariance (6, 6) are finite."""
    for numbers in (R.ravel(), t, covariance.ravel()):
        for number in numbers:
            if not math.isfinite(number):
                return False
    return True


class FitResiduals(NamedTuple):
    """Inputs and residuals of a fit, from which appearance and biases are learned.

    points and patches (rows `chosen`, with their correlation (m,)), the weighting of both; the offsets of the edges in
    view, the sums over a frame and the last step; prior_information (6, 6) of the prediction. steps (n,): number of
    steps of light that locate each control point, 0 where none does; by_numbers (n, r): see `Located`.
    """

    points: ControlPoints
    chosen: Indices
    correlation: Array
    weighting: Weighting
    edges: EdgeOffsets
    sums: FrameSums
    step: Step
    prior_information: Array
    steps: Indices
    by_numbers: Array


PROBLEM = named_tuple(
    Problem,
    "u3 view f2! prior points lines f1! f1! i1! f2!",
    view=VIEW,
    prior=POSE_PRIOR,
    points=CONTROL_POINTS,
    lines=SEARCH_LINES,
)
ALIGNED = named_tuple(Aligned, "view matches", view=VIEW, matches=PATCH_MATCHES)
SOLUTION = named_tuple(
    Solution, "estimate measured edges", estimate=ESTIMATE, measured=EDGE_MEASUREMENTS, edges=EDGE_OFFSETS
)
SEARCHED = named_tuple(Searched, "problem aligned found i1!", problem=PROBLEM, aligned=ALIGNED, found=SOLUTION)
FIT_RESIDUALS = named_tuple(
    FitResiduals,
    "points i1! f1! weighting edges sums step f2! i1! f2!",
    points=CONTROL_POINTS,
    weighting=WEIGHTING,
    edges=EDGE_OFFSETS,
    sums=FRAME_SUMS,
    step=STEP,
)


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose with its covariance (6, 6), and how well the image supports it.

    support in [0, 1]: weighted inlier ratio of the control points and patches; edge_support: of the control points
    alone; found: weight of all inliers; range_m: depth of the middle control point, NaN without any; chance: bounds on
    the probability that a random pose matches as much. searched: what it is based on. Of these there
    are none without control points. finite: whether pose and covariance are.
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
    chance: Chance = CERTAIN
    residuals: FitResiduals | None = None
    searched: Searched | None = None
    finite: bool = field(init=False)

    def __post_init__(self) -> None:
        pose = self.cam_from_world
        finite = unchecked(are_finite)(pose.rotation, pose.translation, self.covariance)
        object.__setattr__(self, "finite", finite)

    @property
    def sigma(self) -> float:
        """Standard deviation of the position, as a fraction of the range, or of the rotation, rad: the larger one."""
        variance = self.covariance.diagonal().tolist()
        return max(math.sqrt(sum(variance[:3])) / self.range_m, math.sqrt(sum(variance[3:])))

    @property
    def focus(self) -> Array | None:
        """Mean (3,) of the control points in the camera frame; None without any."""
        if self.residuals is None or not len(self.residuals.points.points):
            return None
        return np.asarray(self.cam_from_world.transform(self.residuals.points.points).mean(axis=0))

    def with_prior(self, information: Array) -> "Fit":
        """The fit, with the covariance and what is learned from it as by a prior of this information (6, 6)."""
        if self.residuals is None:
            return self
        whole = self.residuals.step.information - self.residuals.prior_information + information
        residuals = self.residuals._replace(prior_information=information)
        return replace(self, covariance=inverse6(whole), residuals=residuals)

    def log10_false_alarms(self, poses: int) -> float:
        """Decimal logarithm of how many of so many random poses are expected to find as much."""
        return self.chance.whole + math.log10(poses)
