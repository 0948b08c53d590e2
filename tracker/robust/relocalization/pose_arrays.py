"""Poses as arrays for kernels: conversion, products, and removal of duplicates."""

import numpy as np

from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.trajectories.pose import Pose


def motion(pose: Pose) -> RigidMotion:
    """A pose as arrays for kernels."""
    return RigidMotion(np.array(pose.rotation, order="C"), np.array(pose.translation))


def product_of(by: RigidMotion, pose: RigidMotion) -> RigidMotion:
    """The product by @ pose."""
    return RigidMotion(by.R @ pose.R, by.R @ pose.t + by.t)


def distinct(guesses: list[RigidMotion], range_m: float, part: float) -> list[RigidMotion]:
    """Guesses without those whose camera centre is within a fraction `part` of the range of the previous guess."""
    kept = guesses[:1]
    for guess in guesses[1:]:
        apart = guess.R.T @ guess.t - kept[-1].R.T @ kept[-1].t
        if np.linalg.norm(apart) > part * range_m:
            kept.append(guess)
    return kept
