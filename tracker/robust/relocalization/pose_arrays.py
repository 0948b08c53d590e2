"""Poses as arrays for kernels: conversion, products, stacks, and removal of duplicates."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.trajectories.pose import Array, Pose


def motion(pose: Pose) -> RigidMotion:
    """A pose as arrays for kernels."""
    return RigidMotion(np.array(pose.rotation, order="C"), np.array(pose.translation))


def product_of(by: RigidMotion, pose: RigidMotion) -> RigidMotion:
    """The product by @ pose."""
    return RigidMotion(by.R @ pose.R, by.R @ pose.t + by.t)


def centre_of(pose: RigidMotion) -> Array:
    """The camera's centre (3,) in the world at a pose."""
    return np.asarray(-pose.R.T @ pose.t)


class PoseStack(NamedTuple):
    """Rotation matrices R (k, 3, 3) and translations t (k, 3)."""

    R: Array
    t: Array

    def moved(self, by: RigidMotion) -> "PoseStack":
        """The poses multiplied by `by` from the left."""
        return PoseStack(by.R @ self.R, self.t @ by.R.T + by.t)

    def added(self, pose: RigidMotion) -> "PoseStack":
        """The poses with one more appended."""
        return PoseStack(np.concatenate([self.R, pose.R[None]]), np.concatenate([self.t, pose.t[None]]))

    def apart(self, pose: RigidMotion, range_m: float, part: float) -> NDArray[np.bool_]:
        """Mask (k,) of the poses whose camera centre is farther from that of another than a fraction `part` of the
        range, or that are turned by more (rad).
        """
        between = np.einsum("kji,kj->ki", self.R, self.t) - pose.R.T @ pose.t
        cosine = (np.einsum("kij,ij->k", self.R, pose.R) - 1.0) / 2.0
        return np.asarray((np.linalg.norm(between, axis=1) > part * range_m) | (cosine < np.cos(min(part, np.pi))))


def stack_of(poses: list[RigidMotion]) -> PoseStack:
    """Poses, one or more, as a stack."""
    return PoseStack(np.stack([pose.R for pose in poses]), np.stack([pose.t for pose in poses]))


NONE = PoseStack(np.zeros((0, 3, 3)), np.zeros((0, 3)))


def distinct(guesses: list[RigidMotion], range_m: float, part: float) -> list[RigidMotion]:
    """Guesses without those that are not apart from all earlier ones (see `PoseStack.apart`)."""
    kept: list[RigidMotion] = []
    stack = NONE
    for guess in guesses:
        if stack.apart(guess, range_m, part).all():
            kept.append(guess)
            stack = stack.added(guess)
    return kept
