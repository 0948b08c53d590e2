"""Pose covariances given in a file, and the errors that they refer to.

`moving`: of the twist xi with world_from_x_true = world_from_x exp(xi), in the axes of the moving frame; uavbench's own
convention, `cam_from_world_true = exp(xi) cam_from_world`, differs only in the sign of xi. `fixed`: of the position
error and the rotation vector of R_true R^T, both in world axes, as in ROS (REP 103).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array, Pose, hat, rotation_from_quaternion
from uavbench.trajectories.trajectory import Trajectory

Axes = Literal["moving", "fixed"]
UPPER = np.triu_indices(6)
COLUMNS = [f"cov_{i}{j}" for i, j in zip(*UPPER, strict=True)]
"""A covariance as columns of a table: its upper triangle by rows."""


@dataclass(frozen=True, eq=False)
class PoseCovariances:
    """Covariances (n, 6, 6) of poses, translation (m) before rotation (rad); NaN where none is given."""

    values: Array
    axes: Axes

    @classmethod
    def of_columns(cls, numbers: Array, axes: Axes) -> "PoseCovariances | None":
        """Covariances of rows (n, 21), the upper triangle by rows, or (n, 36); None if no row has one.

        All zeros, or -1 in the first element, mean unknown, as in ROS.
        """
        if numbers.shape[1] == 36:
            values = np.array(numbers.reshape(-1, 6, 6))
        else:
            values = np.zeros((len(numbers), 6, 6))
            values[:, UPPER[0], UPPER[1]] = values[:, UPPER[1], UPPER[0]] = numbers
        unknown = (values == 0).all(axis=(1, 2)) | (values[:, 0, 0] == -1) | ~np.isfinite(values).all(axis=(1, 2))
        values[unknown] = np.nan
        return None if unknown.all() else cls(values, axes)

    def of_rows(self, rows: NDArray[np.int64]) -> "PoseCovariances":
        """Covariances of the chosen rows."""
        return PoseCovariances(self.values[rows], self.axes)

    def moved(self, x_from_y: Pose, quaternions_wxyz: Array) -> "PoseCovariances":
        """Covariances of world_from_y = world_from_x x_from_y; quaternions (n, 4) of world_from_x."""
        J = np.tile(np.eye(6), (len(self.values), 1, 1))
        if self.axes == "moving":
            back = x_from_y.inverse()
            J[:, :3, :3] = J[:, 3:, 3:] = back.rotation
            J[:, :3, 3:] = hat(back.translation) @ back.rotation
        else:
            J[:, :3, 3:] = -hat(rotation_from_quaternion(quaternions_wxyz) @ x_from_y.translation)
        return PoseCovariances(J @ self.values @ np.swapaxes(J, 1, 2), self.axes)

    def aligned(self, scale: float, rotation: Array) -> "PoseCovariances":
        """Covariances of the poses after a similarity transform with this scale and rotation (3, 3)."""
        J = np.diag([scale] * 3 + [1.0] * 3)
        if self.axes == "fixed":
            J[:3, :3], J[3:, 3:] = scale * rotation, rotation
        return PoseCovariances(J @ self.values @ J.T, self.axes)


@dataclass(frozen=True, eq=False)
class CovariantTrajectory:
    """A trajectory, and the covariances of its poses if its file has any."""

    trajectory: Trajectory
    covariances: PoseCovariances | None = None
