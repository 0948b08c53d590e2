"""Poses of a camera on its gimbal along a flight in closed loop: mounts.csv and plan_mounts.csv."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.camera_path import body_path
from uavbench.scenes.dataset.ground_truth_files import MOUNTS_COLUMNS, MOUNTS_FILE
from uavbench.scenes.dataset.table_files import read_integers, read_numbers
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.sensor import Table, write_table
from uavbench.trajectories.trajectory import Trajectory

MOUNT_COLUMNS = tuple(MOUNTS_COLUMNS[2:])
"""Pose `cam_from_body`, and the angles of the gimbal's joints."""
PLAN_FILE = "plan_mounts.csv"


@dataclass(frozen=True, eq=False)
class FlownMounts:
    """A camera on its gimbal, in tables of MOUNT_COLUMNS.

    flown: its true pose on the body at the rows of path.csv; planned: that at the rows of plan.csv, with the vehicle
    level and the gimbal at rest.
    """

    flown: Table
    planned: Table

    def write(self, new: Path) -> None:
        """Write both files into the folder of a flight."""
        write_table(self.flown, new / MOUNTS_FILE)
        write_table(self.planned, new / PLAN_FILE)

    @classmethod
    def load(cls, folder: Path, path_ns: NDArray[np.int64], plan_ns: NDArray[np.int64]) -> "FlownMounts":
        """Read what `write` wrote; UserError naming the file that is missing, invalid, or of other stamps (n,)."""
        return cls(_read(folder / MOUNTS_FILE, path_ns), _read(folder / PLAN_FILE, plan_ns))

    @property
    def at(self) -> Callable[[int], Pose]:
        """True `cam_from_body` at a time (ns), by constant twist between rows."""
        poses = (pose_of(self.flown, row) for row in range(len(self.flown.stamps_ns)))
        return body_path(Trajectory.from_poses(self.flown.stamps_ns.tolist(), poses))


def pose_of(table: Table, row: int) -> Pose:
    """`cam_from_body` of a row of a table of MOUNT_COLUMNS."""
    return Pose.from_quaternion(table.values[row, 3:7], table.values[row, 0:3])


def _read(path: Path, stamps_ns: NDArray[np.int64]) -> Table:
    table = Table(MOUNT_COLUMNS, read_integers(path, ["stamp_ns"])[:, 0], read_numbers(path, list(MOUNT_COLUMNS)))
    if not np.array_equal(table.stamps_ns, stamps_ns):
        raise UserError(f"{path}: its stamps are not those of the flight; fly again")
    if not (np.abs(np.linalg.norm(table.values[:, 3:7], axis=1) - 1) <= 1e-6).all():
        raise UserError(f"{path}: has a row that is not a pose; fly again")
    return table
