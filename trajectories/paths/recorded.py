"""The path `recorded`: a trajectory from a file, replayed exactly."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.recorded_file import (
    check_order_is_known,
    check_speed,
    check_stamps,
    check_upright,
)
from uavbench.trajectories.paths.reference import Replay
from uavbench.trajectories.paths.timing import check_flight_time
from uavbench.trajectories.pose import Array, Pose, quaternion_from_rotation
from uavbench.trajectories.record_columns import RECORD, RECORD_COLUMNS
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import declared_frame, read_trajectory
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

LONGEST_GAP_S = 1.0
"""Longest gap between two recorded poses that is interpolated."""
FRAMES = {"body": "world_from_body", "camera": "world_from_cam"}
"""Declared frames that a file may have, by `frame`."""


@dataclass(frozen=True)
class Recorded:
    """A recorded trajectory (tum, euroc or kitti) whose poses are reproduced exactly; no vehicle is simulated.

    Between the recorded poses the motion is a cubic spline of position and of rotation (twice continuously
    differentiable, so inertial measurements have no steps). `frame` tells whether the file has poses of the vehicle's
    body or of the camera. Stamps are relative to the first one of the file. A body that is upside down, or
    upright only with the quaternions in the other order, stamps less than 0.1 ms apart, and poses between which it
    would move at more than 200 m/s are refused.
    """

    file: str = "trajectory.tum"
    format: Literal["tum", "euroc", "kitti"] | None = None
    frame: Literal["body", "camera"] = "body"

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Replay:
        """The recorded motion at every step; UserError naming the file when it has too few poses or a long gap."""
        file = Path(self.file)
        given, format = read_trajectory(file, self.format)
        if self.format is None and format == "euroc":
            check_order_is_known(file)
        said, meant = declared_frame(file), FRAMES[self.frame]
        if said in ("world_from_body", "world_from_cam") and said != meant:
            raise UserError(f"{self.file}: declares {said}, but frame = {self.frame!r} needs {meant}")
        gaps = np.diff(given.stamps_ns)
        if len(given) < 4:
            raise UserError(f"{self.file}: needs at least four poses, has {len(given)}")
        check_stamps(file, format, given)
        if gaps.max() > LONGEST_GAP_S * 1e9:
            row = int(np.argmax(gaps))
            raise UserError(
                f"{self.file}: {gaps[row] / 1e9:.3f} s without a pose after pose {row}; at most {LONGEST_GAP_S} s are "
                "interpolated"
            )
        check_speed(file, given)
        check_flight_time(float(given.stamps_ns[-1] - given.stamps_ns[0]) / 1e9)
        body = self._of_body(given, mount)
        check_upright(file, self.frame, body)
        return Replay(resampled(body))

    def _of_body(self, given: Trajectory, mount: Mount) -> Trajectory:
        if self.frame == "body":
            return given
        poses: list[Pose] = [given.pose(i) @ mount.cam_from_body for i in range(len(given))]
        return Trajectory.from_poses(given.stamps_ns.tolist(), poses)


def resampled(given: Trajectory) -> Array:
    """Record (n, 30) of a trajectory at the control steps from its first stamp to its last, with motors off."""
    from scipy.interpolate import CubicSpline  # lazy: slow to import and rarely needed
    from scipy.spatial.transform import Rotation, RotationSpline

    offsets = given.stamps_ns - given.stamps_ns[0]
    times = offsets / 1e9
    steps = np.arange(int(offsets[-1]) // STEP_NS + 1)
    at = steps * STEP_NS / 1e9
    position = CubicSpline(times, given.positions_m)
    turn = RotationSpline(times, Rotation.from_matrix(given.rotations))
    record = np.zeros((len(at), RECORD_COLUMNS))
    for name, values in (
        ("positions_m", position(at)),
        ("velocities_m_s", position(at, 1)),
        ("accelerations_m_s2", position(at, 2)),
        ("quaternions_wxyz", quaternion_from_rotation(turn(at).as_matrix())),
        ("angular_velocities_rad_s", turn(at, 1)),
        ("angular_accelerations_rad_s2", turn(at, 2)),
    ):
        record[:, RECORD[name]] = values
    return record
