"""Camera poses of many frames as arrays: rotations (n, 3, 3) and translations (n, 3) of `cam_from_world`."""

from collections.abc import Sequence as ListOf
from typing import NamedTuple

import numpy as np

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results, cam_from_evaluated, evaluated_poses
from uavbench.trajectories.pose import Array, Pose


class Poses(NamedTuple):
    """Rotations R (n, 3, 3) and translations t (n, 3)."""

    R: Array
    t: Array


def true_cameras(sequence: Sequence, frames: ListOf[int]) -> Poses:
    """True cam_from_world (n) at frames of a sequence."""
    ground_truth = evaluated_poses(sequence).select(np.asarray(frames, dtype=np.int64))
    mount = cam_from_evaluated(sequence)
    R: Array = mount.rotation @ np.swapaxes(ground_truth.rotations, 1, 2)
    return Poses(R, mount.translation - np.einsum("nij,nj->ni", R, ground_truth.positions_m))


def estimated_cameras(results: Results) -> Poses:
    """Estimated cam_from_world (n) of each row; NaN where it is missing or not finite."""
    R, t = np.full((len(results), 3, 3), np.nan), np.full((len(results), 3), np.nan)
    for i, row in enumerate(results.rows):
        if row.cam_from_world is not None:
            R[i], t[i] = row.cam_from_world.rotation, row.cam_from_world.translation
    bad = ~(np.isfinite(R).all(axis=(1, 2)) & np.isfinite(t).all(axis=1))
    R[bad], t[bad] = np.nan, np.nan
    return Poses(R, t)


def bodies(R: Array, t: Array, cam_from_body: Pose) -> Poses:
    """Rotations and translations of `world_from_body` for cameras R (n, 3, 3), t (n, 3)."""
    back = np.swapaxes(R, 1, 2)
    rotations: Array = back @ cam_from_body.rotation
    return Poses(rotations, np.einsum("nij,nj->ni", back, cam_from_body.translation - t))
