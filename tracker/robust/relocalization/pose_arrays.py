"""Poses as arrays that kernels take: of a pose, moved, and those of several guesses that differ."""

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.trajectories.pose import Pose


def motion(pose: Pose) -> RigidMotion:
    """A pose in arrays that kernels take."""
    return RigidMotion(np.array(pose.rotation, order="C"), np.array(pose.translation))


def product_of(by: RigidMotion, pose: RigidMotion) -> RigidMotion:
    """A pose moved from the left."""
    return RigidMotion(by.R @ pose.R, by.R @ pose.t + by.t)


def distinct(guesses: list[RigidMotion], range_m: float, part: float) -> list[RigidMotion]:
    """Guesses without those whose camera is within a part of the range of the one before."""
    kept = guesses[:1]
    for guess in guesses[1:]:
        apart = guess.R.T @ guess.t - kept[-1].R.T @ kept[-1].t
        if np.linalg.norm(apart) > part * range_m:
            kept.append(guess)
    return kept
