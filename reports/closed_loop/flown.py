"""A flight in closed loop on disk: the input of its measures and figures.

    record.json      configuration, how and when the flight ended, and the tracker's errors with their times
    path.csv         true state, estimated state and its standard deviations, planned position, at 50 Hz
    plan.csv         planned position and yaw of the same flight on its true state, at 10 Hz
    frames.csv ...   results of the tracker, as for a sequence (`uavbench.tracker.results`), and ground truth
    answers.csv      when each frame's result reached the filter
    innovations.csv  innovation of each measurement, and whether the filter rejected it
    imu.csv ...      readings of each of the body's sensors, as the vehicle had them; gimbal.csv those of the encoders
    mounts.csv       of a camera on a gimbal, its true pose on the body at each row of path.csv
    plan_mounts.csv  and that at each row of plan.csv, with the vehicle level
    model.obj edges.csv camera.toml    the structure and the camera

Except for times.csv and its hash in record.json, all files are identical byte for byte on every run, unless the latency
is a measured one.
"""

from collections.abc import Mapping
from collections.abc import Sequence as ListOf
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.closed_loop.files import MARKER
from uavbench.reports.closed_loop.flown_mounts import FlownMounts, pose_of
from uavbench.reports.style import write_csv
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.structure_files import load_structure, save_structure
from uavbench.scenes.dataset.table_files import read_numbers, read_table
from uavbench.scenes.structure import Structure
from uavbench.tracker.results import Results
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import new_folder
from uavbench.trajectories.pose import Array, Pose, rotation_exp
from uavbench.trajectories.sensors.sensor import Table, write_table
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import read_trajectory

GROUPS = {
    "true_p_m": 3, "true_q": 4, "true_v_m_s": 3,
    "estimated_p_m": 3, "estimated_q": 4, "estimated_v_m_s": 3,
    "sigma_p_m": 3, "nees": 1, "planned_p_m": 3, "planned_yaw_rad": 1, "gnss_fix": 1,
}  # fmt: skip
"""Groups of columns of path.csv after the stamp, and their widths; quaternions wxyz, NEES with 9 degrees of freedom
(position, velocity, attitude)."""
COLUMNS = ["stamp_ns", *(f"{name}_{k}" if width > 1 else name for name, width in GROUPS.items() for k in range(width))]
INNOVATION_COLUMNS = ["stamp_ns", "kind", "d2", "dof", "refused"]
ANSWER_COLUMNS = ["stamp_ns", "answered_ns"]
PLAN_COLUMNS = ["t_s", "px_m", "py_m", "pz_m", "yaw_rad"]


@dataclass(frozen=True, eq=False)
class FlownPath:
    """Rows of path.csv: stamps_ns (n,), values (n, k) in the order of GROUPS; NaN for empty cells."""

    stamps_ns: NDArray[np.int64]
    values: Array

    def group(self, name: str) -> Array:
        """Columns (n, w) of one of GROUPS; KeyError for any other name."""
        first = 0
        for other, width in GROUPS.items():
            if other == name:
                return self.values[:, first : first + width]
            first += width
        raise KeyError(name)

    @property
    def seconds(self) -> Array:
        """Time (n,) in s since the start."""
        return np.asarray(self.stamps_ns / 1e9)


@dataclass(frozen=True, eq=False)
class Flown:
    """One flight in closed loop.

    groundtruth: of the body at each frame, of the camera if it is on a gimbal; plan (n, 5): columns PLAN_COLUMNS;
    answered_ns (frames,): when each result reached the filter; innovations: rows of INNOVATION_COLUMNS; readings: of
    the body's sensors by name; empty when loaded, as no measure needs them; mounts: poses of a camera on a gimbal.
    """

    results: Results
    groundtruth: Trajectory
    path: FlownPath
    plan: Array
    answered_ns: NDArray[np.int64]
    innovations: ListOf[ListOf[Any]]
    structure: Structure
    camera: Camera
    readings: Mapping[str, Table] = field(default_factory=dict)
    mounts: FlownMounts | None = None

    @property
    def record(self) -> dict[str, Any]:
        """Content of record.json."""
        return dict(self.results.record)

    def cam_from_body(self, row: int) -> Pose:
        """True pose of the camera on the body at a row of the path."""
        return self.results.cam_from_body if self.mounts is None else pose_of(self.mounts.flown, row)

    def planned_cam_from_body(self, row: int) -> Pose:
        """Pose of the camera on the level body at a row of the plan."""
        return self.results.cam_from_body if self.mounts is None else pose_of(self.mounts.planned, row)

    def save(self, folder: Path) -> None:
        """Write the folder atomically."""
        with new_folder(folder, MARKER) as new:
            self.results.write(new, self.groundtruth)
            rows = zip(self.path.stamps_ns.tolist(), self.path.values.tolist(), strict=True)
            write_csv(new / "path.csv", COLUMNS, ([stamp, *map(_number, row)] for stamp, row in rows))
            write_csv(new / "plan.csv", PLAN_COLUMNS, self.plan.tolist())
            answers = np.column_stack([self.results.stamps_ns, self.answered_ns]).reshape(-1, 2)
            write_csv(new / "answers.csv", ANSWER_COLUMNS, answers.tolist())
            write_csv(new / "innovations.csv", INNOVATION_COLUMNS, self.innovations)
            for name, table in self.readings.items():
                write_table(table, new / f"{name}.csv")
            if self.mounts is not None:
                self.mounts.write(new)
            save_structure(self.structure, new)
            self.camera.save(new / "camera.toml")

    @classmethod
    def load(cls, folder: Path) -> "Flown":
        """Read a folder that `save` wrote; UserError naming the file that is missing or invalid."""
        results = Results.load(folder)
        if "flight" not in results.record:
            raise UserError(f"{folder / MARKER.name}: is not the record of a flight; fly again")
        table = read_table(folder / "path.csv", COLUMNS)
        try:
            stamps = np.array([int(row["stamp_ns"]) for row in table], dtype=np.int64)
            values = np.array([[float(row[c]) if row[c] else np.nan for c in COLUMNS[1:]] for row in table])
            answered = [int(row["answered_ns"]) for row in read_table(folder / "answers.csv", ANSWER_COLUMNS)]
        except ValueError as error:
            raise UserError(f"{folder / 'path.csv'}: {error}; fly again") from None
        told = read_table(folder / "innovations.csv", INNOVATION_COLUMNS)
        plan = read_numbers(folder / "plan.csv", PLAN_COLUMNS)
        mounts = None
        if results.frame == "world_from_cam":
            mounts = FlownMounts.load(folder, stamps, plan_stamps(plan))
        return cls(
            results,
            read_trajectory(folder / f"groundtruth_{results.frame}.tum", "tum")[0],
            FlownPath(stamps, values.reshape(len(stamps), len(COLUMNS) - 1)),
            plan,
            np.array(answered, dtype=np.int64),
            [[row[c] for c in INNOVATION_COLUMNS] for row in told],
            load_structure(folder),
            Camera.load(folder / "camera.toml", inside=folder),
            mounts=mounts,
        )


def planned_bodies(plan: Array) -> list[Pose]:
    """Poses world_from_body of the level vehicle at the rows of a plan (n, 5)."""
    turns = rotation_exp(np.column_stack([np.zeros((len(plan), 2)), plan[:, 4]]))
    return [Pose(turn, row[1:4]) for turn, row in zip(turns, plan, strict=True)]


def plan_stamps(plan: Array) -> NDArray[np.int64]:
    """Stamps (n,) in ns of the rows of a plan."""
    return np.rint(plan[:, 0] * 1e9).astype(np.int64)


def _number(value: float) -> float | None:
    return None if value != value else value
