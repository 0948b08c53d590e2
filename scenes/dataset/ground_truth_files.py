"""Files of a sequence's ground truth: motion at each frame, poses of image rows, bounds of the camera's pose."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.table_files import ANEW, read_integers, read_numbers
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import ANY, LARGEST_COORDINATE_M
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, rotation_log
from uavbench.trajectories.trajectory import Trajectory

GROUND_TRUTH_COLUMNS = [
    "frame", "stamp_ns",
    "px_m", "py_m", "pz_m",
    "qw", "qx", "qy", "qz",
    "vx_m_s", "vy_m_s", "vz_m_s",
    "wx_rad_s", "wy_rad_s", "wz_rad_s",
    "ax_m_s2", "ay_m_s2", "az_m_s2",
]  # fmt: skip
"""Pose `world_from_body`, velocity and acceleration in the world, angular velocity in the body."""
UPPER = np.triu_indices(6)
BOUND_COLUMNS = [f"cov_{i}{j}" for i, j in zip(*UPPER, strict=True)]
"""A covariance in `crlb.csv`: its upper triangle by rows."""

MOUNTS_FILE = "mounts.csv"
"""File of a camera's poses on the body; `cam_from_body` in `sequence.json` is this name where they change in flight."""
MOUNTS_COLUMNS = [
    "frame", "stamp_ns",
    "px_m", "py_m", "pz_m",
    "qw", "qx", "qy", "qz",
    "yaw_rad", "roll_rad", "pitch_rad",
]  # fmt: skip
"""Pose `cam_from_body`, and the true angles of the gimbal's joints."""


def write_ground_truth(folder: Path, stamps_ns: NDArray[np.int64], states: Array) -> None:
    """Write groundtruth.csv of states (n, 16), the columns of GROUND_TRUTH_COLUMNS from px_m on, at stamps (n,)."""
    rows = zip(stamps_ns.tolist(), states.tolist(), strict=True)
    lines = [",".join(map(repr, [i, stamp, *row])) for i, (stamp, row) in enumerate(rows)]
    write_text(folder / "groundtruth.csv", "\n".join([",".join(GROUND_TRUTH_COLUMNS), *lines]) + "\n")


def states_of(world_from_body: Trajectory) -> Array:
    """States (n, 16) of poses that are known at single times only: motion by differences to the poses on both sides.

    Velocities and accelerations are np.gradient's, rates those of the rotation from the pose before to the one behind;
    at both ends differences are to one side, and a single pose is at rest. Noise of the poses is not filtered.
    """
    n, motion = len(world_from_body), np.zeros((len(world_from_body), 9))
    quaternions = world_from_body.quaternions_wxyz
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    if n > 1:
        t = (world_from_body.stamps_ns - world_from_body.stamps_ns[0]) / 1e9
        before, behind = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
        motion[:, :3] = np.gradient(world_from_body.positions_m, t, axis=0)
        R = world_from_body.rotations
        turned = rotation_log(np.swapaxes(R[before], 1, 2) @ R[behind])
        motion[:, 3:6] = turned / (t[behind] - t[before])[:, None]
        motion[:, 6:] = np.gradient(motion[:, :3], t, axis=0)
    return np.hstack([world_from_body.positions_m, unit, motion])


def read_ground_truth(folder: Path, stamps_ns: NDArray[np.int64]) -> Array:
    """groundtruth.csv (n, 18) in the order of GROUND_TRUTH_COLUMNS; UserError unless it has these stamps (n,)."""
    path = folder / "groundtruth.csv"
    table = read_numbers(path, GROUND_TRUTH_COLUMNS)
    if not (np.abs(table[:, 2:]) <= LARGEST_COORDINATE_M).all():
        row = int(np.argmin((np.abs(table[:, 2:]) <= LARGEST_COORDINATE_M).all(axis=1)))
        raise UserError(f"{path}: row {row}: a number beyond {LARGEST_COORDINATE_M:g}; {ANEW}")
    if not np.array_equal(read_integers(path, ["stamp_ns"])[:, 0], stamps_ns):
        raise UserError(f"{folder / 'groundtruth.csv'}: its stamps differ from those of frames.csv; {ANEW}")
    return table


def read_mounts(folder: Path, stamps_ns: NDArray[np.int64]) -> Array:
    """Poses `cam_from_body` (n, 7) at each frame: px py pz qw qx qy qz; UserError unless it has these stamps (n,)."""
    path = folder / MOUNTS_FILE
    table = read_numbers(path, MOUNTS_COLUMNS[2:9])
    if not np.array_equal(read_integers(path, ["stamp_ns"])[:, 0], stamps_ns):
        raise UserError(f"{path}: its stamps differ from those of frames.csv; {ANEW}")
    turned = np.abs(np.linalg.norm(table[:, 3:], axis=1) - 1) <= 1e-6
    if not (turned & (np.abs(table) <= LARGEST_COORDINATE_M).all(axis=1)).all():
        raise UserError(f"{path}: has a row that is not a pose; {ANEW}")
    return table


def read_pose_bounds(folder: Path) -> dict[int, Array]:
    """Cramer-Rao bound (6, 6) of the twist of `cam_from_world`, by frame; none where crlb.csv is missing."""
    path = folder / "crlb.csv"
    if not path.is_file():
        return {}
    frames, table = read_integers(path, ["frame"])[:, 0], read_numbers(path, BOUND_COLUMNS)
    bounds = np.zeros((len(table), 6, 6))
    bounds[:, UPPER[0], UPPER[1]] = bounds[:, UPPER[1], UPPER[0]] = table
    return dict(zip(frames.tolist(), bounds, strict=True))


def read_row_poses(folder: Path, frames: int, height: int) -> Array:
    """row_poses.npy: `world_from_body` (n, h, 7) of the rows of all frames, px py pz qw qx qy qz, mapped, not read yet.

    UserError naming the file when it is missing, leads out of the folder, or does not hold them.
    """
    path = folder / "row_poses.npy"
    with opened(path, ANY, inside=folder):
        pass
    try:
        found = np.lib.format.open_memmap(path, mode="r")
    except (ValueError, SyntaxError, TypeError, OverflowError) as error:
        raise UserError(f"{path}: not an array of poses: {error}; {ANEW}") from None
    expected = (frames, height, 7)
    if found.shape != expected or found.dtype != np.float64:
        raise UserError(f"{path}: is {found.shape} {found.dtype}, not {expected} float64; {ANEW}")
    return found
