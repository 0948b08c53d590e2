"""The poses that a search has fitted, to avoid repetitions and to compare the best one with the others."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.relocalization.pose_arrays import NONE, PoseStack
from uavbench.tracker.robust.relocalization.scoring.pose_search import Candidate, PoseSearch
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import seen_alike
from uavbench.trajectories.pose import Array

COMPARED = 12
"""Number of edge points by which two poses are compared, spread over all visible edges."""


@dataclass
class TriedPoses:
    """Poses that were fitted, and those to which the fits converged.

    scores (k,): of the poses in the images to which they were fitted, 0 for those not from the pose search; supports
    (k,): of the fits; rivals: poses that were fitted as rivals of another; seen (n, 3): edge points by which poses are
    compared.
    """

    searcher: PoseSearch
    fitted: PoseStack = NONE
    reached: PoseStack = NONE
    scores: Array = field(default_factory=lambda: np.zeros(0))
    supports: Array = field(default_factory=lambda: np.zeros(0))
    rivals: PoseStack = NONE
    seen: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.scores)

    def add(self, fitted: RigidMotion, score: float, reached: RigidMotion, support: float) -> None:
        """Add a fit."""
        self.fitted, self.reached = self.fitted.added(fitted), self.reached.added(reached)
        self.scores, self.supports = np.append(self.scores, score), np.append(self.supports, support)

    def move(self, by: RigidMotion) -> None:
        """Multiply all poses by `by` from the left."""
        self.fitted, self.reached = self.fitted.moved(by), self.reached.moved(by)
        self.rivals = self.rivals.moved(by)

    def give_up(self, pose: RigidMotion) -> None:
        """No longer compare the best pose with fits that ended at this one, which goes on in the fits of a new image.

        Where they are meanwhile is known by a prediction only, and an error of it makes them another pose.
        """
        self.supports = np.where(self.within_reach(pose, self.reached), 0.0, self.supports)

    def best_elsewhere(self, pose: RigidMotion) -> RigidMotion | None:
        """The pose with most support to which fits converged out of reach of a pose; None without any."""
        supports = np.where(self.within_reach(pose, self.reached), 0.0, self.supports)
        k = int(np.argmax(supports)) if len(supports) else 0
        return RigidMotion(self.reached.R[k], self.reached.t[k]) if supports.any() else None

    def holds(self, candidate: Candidate) -> bool:
        """Whether a pose within reach of a fit from this candidate was fitted, with a similar score."""
        reached = self.within_reach(candidate.pose, self.fitted)
        return bool((reached & (self.scores > candidate.score - self.searcher.clear_score)).any())

    def within_reach(self, pose: RigidMotion, poses: PoseStack) -> NDArray[np.bool_]:
        """Mask (k,) of the poses from which a fit reaches a pose: no edge point moves by a step of shifts or more."""
        step_px = float(self.searcher.config.truncation_px)
        return seen_alike(self.seen[:COMPARED], pose, poses.R, poses.t, self.searcher.camera, step_px)
