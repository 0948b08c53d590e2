"""The poses that a search has fitted, so that none is fitted twice and the best one is held against the others."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.trajectories.pose import Array


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
    supports (k,) of the fits.
    """

    fitted: PoseStack = NONE
    reached: PoseStack = NONE
    scores: Array = field(default_factory=lambda: np.zeros(0))
    supports: Array = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.scores)

    def add(self, fitted: RigidMotion, score: float, reached: RigidMotion, support: float) -> None:
        """Remember a fit."""
        self.fitted, self.reached = self.fitted.added(fitted), self.reached.added(reached)
        self.scores, self.supports = np.append(self.scores, score), np.append(self.supports, support)

    def move(self, by: RigidMotion) -> None:
        """Move all along."""
        self.fitted, self.reached = self.fitted.moved(by), self.reached.moved(by)
