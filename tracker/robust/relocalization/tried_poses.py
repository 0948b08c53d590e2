"""The poses that a search has fitted, so that none is fitted twice and the best one is held against the others."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.relocalization.pose_search import Candidate, PoseSearch
from uavbench.trajectories.pose import Array

COMPARED = 12
"""Edge points by which two poses are compared: they are spread over all that is seen."""


class PoseStack(NamedTuple):
    """Rotation matrices R (k, 3, 3) and translations t (k, 3)."""

    R: Array
    t: Array

    def moved(self, by: RigidMotion) -> "PoseStack":
        """The poses moved from the left."""
        return PoseStack(by.R @ self.R, self.t @ by.R.T + by.t)

    def added(self, pose: RigidMotion) -> "PoseStack":
        """The poses with one more."""
        return PoseStack(np.concatenate([self.R, pose.R[None]]), np.concatenate([self.t, pose.t[None]]))


NONE = PoseStack(np.zeros((0, 3, 3)), np.zeros((0, 3)))


@dataclass
class TriedPoses:
    """Poses that were fitted, and those that the fits reached.

    scores (k,) of the poses in the images that they were fitted to, 0 for those that were not found by their score;
    supports (k,) of the fits; rivals: the poses that were fitted as rivals of another; seen (n, 3) edge points by which
    poses are compared.
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
        """Remember a fit."""
        self.fitted, self.reached = self.fitted.added(fitted), self.reached.added(reached)
        self.scores, self.supports = np.append(self.scores, score), np.append(self.supports, support)

    def move(self, by: RigidMotion) -> None:
        """Move all along."""
        self.fitted, self.reached = self.fitted.moved(by), self.reached.moved(by)
        self.rivals = self.rivals.moved(by)

    def holds(self, candidate: Candidate) -> bool:
        """Whether a pose within reach of a fit from this one was fitted, in an image that it agreed with as well."""
        reached = self.within_reach(candidate.pose, self.fitted)
        return bool((reached & (self.scores > candidate.score - self.searcher.config.clear_score)).any())

    def within_reach(self, pose: RigidMotion, poses: PoseStack) -> NDArray[np.bool_]:
        """Whether a fit from each of the poses (k,) reaches a pose: no edge point seen is a step of shifts away."""
        points, step = self.seen[:COMPARED], self.searcher.config.truncation_px
        there = self.searcher.pixels(pose.R[None], pose.t[None], points)
        at = self.searcher.pixels(poses.R, poses.t, points)
        return np.asarray((np.abs(at - there) < step).all(axis=(1, 2)))
