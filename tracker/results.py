"""The results of one tracker on one sequence, and their folder.

    record.json    provenance: tracker and parameters, rate, seed, sequence, versions, hash, list of files
    frames.csv     frame, stamp_ns, status, cam_from_world, covariance, counts, log10_nfa; blank where undefined
    times.csv      frame, wall-clock time of each stage in ms
    estimate_world_from_body.tum      the frames that are ok; estimate_world_from_cam.tum if the mount is unknown
    groundtruth_world_from_body.tum   ground truth at every tracked frame, if known

All files are byte-identical on every run, except times.csv and its hash in record.json.
"""

import csv
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_json, read_table
from uavbench.tracker.protocol import Status, TrackResult
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.seals import seal_table
from uavbench.trajectories.files.writing import new_folder, write_text
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

MARKER = Marker("record.json", "estimates of a tracker")
"""File of a results folder that lists the others."""
POSE_COLUMNS = ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"]
COVARIANCE_COLUMNS = [f"cov_{i}{j}" for i in range(6) for j in range(i, 6)]
COUNT_COLUMNS = ["segments", "control_points", "candidates", "inliers"]
FRAME_COLUMNS = ["frame", "stamp_ns", "status", *POSE_COLUMNS, *COVARIANCE_COLUMNS, *COUNT_COLUMNS]
NFA_COLUMN = "log10_nfa"
"""The last column of frames.csv; results of earlier versions do not have it."""
UPPER = np.triu_indices(6)


@dataclass(frozen=True, eq=False)
class Results:
    """One row per tracked frame.

    frames (n,): indices into the sequence; stamps_ns (n,): their stamps; record: content of `record.json`, including
    the mount `cam_from_body` (4, 4).
    """

    record: Mapping[str, Any]
    frames: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    rows: tuple[TrackResult, ...]

    def __post_init__(self) -> None:
        for name in ("frames", "stamps_ns"):
            values = np.array(getattr(self, name), dtype=np.int64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if not len(self.frames) == len(self.stamps_ns) == len(self.rows):
            raise ValueError("frames, stamps_ns and rows must have the same length")

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Whether each frame has a pose (n,)."""
        return np.array([row.status == "ok" for row in self.rows], dtype=bool)

    @property
    def summary(self) -> str:
        """How many frames have a pose, and what became of the others, for people."""
        count = Counter(row.status for row in self.rows)
        others = [f"{count[status]} {status.replace('_', ' ')}" for status in get_args(Status)[1:] if count[status]]
        return ", ".join([f"{count['ok']} of {len(self)} frames with a pose", *others])

    @property
    def cam_from_body(self) -> Pose:
        """Mount of the camera on the vehicle."""
        return Pose.from_matrix(self.record["cam_from_body"])

    @property
    def cam_from_world(self) -> tuple[Pose, ...]:
        """Estimated camera poses of the frames that are ok."""
        return tuple(row.cam_from_world for row in self.rows if row.cam_from_world is not None)

    @property
    def estimate(self) -> Trajectory:
        """Estimated `world_from_body` of the frames that are ok."""
        mount = self.cam_from_body
        poses = [cam_from_world.inverse() @ mount for cam_from_world in self.cam_from_world]
        return Trajectory.from_poses(self.stamps_ns[self.ok].tolist(), poses)

    @property
    def frame(self) -> str:
        """Frame of `estimate`: `world_from_body`, or `world_from_cam` if the mount is unknown."""
        return "world_from_cam" if np.array_equal(self.cam_from_body.matrix, np.eye(4)) else "world_from_body"

    def save(self, folder: Path, groundtruth: Trajectory | None = None) -> None:
        """Write the folder atomically; groundtruth: in the frame of `estimate`."""
        with new_folder(folder, MARKER) as new:
            self.write(new, groundtruth)

    def write(self, new: Path, groundtruth: Trajectory | None = None) -> None:
        """Write the files into a new folder; groundtruth: in the frame of `estimate`."""
        write_text(new / MARKER.name, json.dumps(dict(self.record), indent=1, sort_keys=True) + "\n")
        _write_csv(new / "frames.csv", [*FRAME_COLUMNS, NFA_COLUMN], [self._frame_cells(i) for i in range(len(self))])
        stages = list(dict.fromkeys(name for row in self.rows for name in row.stage_ms))
        times = [
            [str(frame), *(_cell(row.stage_ms.get(name)) for name in stages)]
            for frame, row in zip(self.frames.tolist(), self.rows, strict=True)
        ]
        _write_csv(new / "times.csv", ["frame", *(f"{name}_ms" for name in stages)], times)
        seal_table(new / "times.csv", MARKER.kind)
        write_tum(self.estimate, new / f"estimate_{self.frame}.tum", self.frame)
        if groundtruth is not None:
            write_tum(groundtruth, new / f"groundtruth_{self.frame}.tum", self.frame)

    @classmethod
    def load(cls, folder: Path) -> "Results":
        """Read what `save` wrote; UserError naming the invalid file and line."""
        record = read_json(folder / "record.json")
        _check_record(record, folder / "record.json")
        table = read_table(folder / "frames.csv", FRAME_COLUMNS)
        times = read_table(folder / "times.csv", ["frame"])
        if [row["frame"] for row in times] != [row["frame"] for row in table]:
            raise UserError(f"{folder / 'times.csv'}: its frames differ from those of frames.csv; track again")
        rows: list[TrackResult] = []
        for number, (cells, ms) in enumerate(zip(table, times, strict=True), start=2):
            try:
                rows.append(_read_row(cells, ms))
            except (ValueError, KeyError) as error:
                raise UserError(f"{folder / 'frames.csv'}: line {number}: {error}; track again") from None
        try:
            frames = np.array([int(row["frame"]) for row in table], dtype=np.int64)
            stamps = np.array([int(row["stamp_ns"]) for row in table], dtype=np.int64)
        except (ValueError, OverflowError) as error:
            raise UserError(f"{folder / 'frames.csv'}: {error}; track again") from None
        return cls(record, frames, stamps, tuple(rows))

    def _frame_cells(self, i: int) -> list[str]:
        row = self.rows[i]
        pose: list[Any] = [None] * 7
        if row.cam_from_world is not None:
            pose = [*row.cam_from_world.translation.tolist(), *row.cam_from_world.quaternion_wxyz.tolist()]
        covariance: list[Any] = [None] * 21 if row.covariance is None else row.covariance[UPPER].tolist()
        counts = [getattr(row, name) for name in COUNT_COLUMNS]
        cells = [*pose, *covariance, *counts, row.log10_nfa]
        return [str(self.frames[i]), str(self.stamps_ns[i]), row.status, *map(_cell, cells)]


def cam_from_evaluated(sequence: Sequence) -> Pose:
    """`cam_from_body` of the results of a sequence; the identity on a gimbal, where the camera's own pose counts."""
    return Pose.identity() if sequence.on_gimbal else sequence.cam_from_body


@lru_cache(maxsize=16)  # asked for by every metric and figure
def evaluated_poses(sequence: Sequence) -> Trajectory:
    """What `estimate` is compared with: true `world_from_body` at each frame, `world_from_cam` on a gimbal."""
    if not sequence.on_gimbal:
        return sequence.ground_truth
    poses = [sequence.true_cam_from_world(frame).inverse() for frame in range(len(sequence))]
    return Trajectory.from_poses(sequence.stamps_ns.tolist(), poses)


def _check_record(record: Mapping[str, Any], path: Path) -> None:
    """Raise UserError naming the first invalid key of a record."""
    tracker, sequence, errors = record.get("tracker"), record.get("sequence", {}), record.get("errors", [])
    rate_hz, seed = record.get("rate_hz"), record.get("seed")
    good = {
        "tracker": isinstance(tracker, dict) and isinstance(tracker.get("kind"), str),
        "sequence": isinstance(sequence, dict),
        "errors": isinstance(errors, list),
        "rate_hz": isinstance(rate_hz, int | float) and 0 < rate_hz < float("inf"),
        "seed": isinstance(seed, int) and seed >= 0,
    }
    try:
        Pose.from_matrix(record["cam_from_body"])
    except (KeyError, ValueError, TypeError, OverflowError):
        good["cam_from_body"] = False
    for key, fine in good.items():
        if key in record and not fine:
            raise UserError(f"{path}: `{key}` is not what a record says there; track again")


def _read_row(cells: Mapping[str, str], ms: Mapping[str, str]) -> TrackResult:
    status: Status = next((s for s in get_args(Status) if s == cells["status"]), "lost")
    if status != cells["status"]:
        raise ValueError(f"status {cells['status']!r} is none of {', '.join(get_args(Status))}")
    pose = covariance = None
    if cells["px_m"]:
        numbers = [float(cells[c]) for c in POSE_COLUMNS]
        pose = Pose.from_quaternion(numbers[3:], numbers[:3])
    if cells["cov_00"]:
        covariance = np.zeros((6, 6))
        covariance[UPPER] = [float(cells[c]) for c in COVARIANCE_COLUMNS]
        covariance = covariance + np.triu(covariance, 1).T
    counts: dict[str, Any] = {name: int(cells[name]) if cells[name] else None for name in COUNT_COLUMNS}
    stage_ms = {name.removesuffix("_ms"): float(value) for name, value in ms.items() if name != "frame" and value}
    if not np.isfinite(list(stage_ms.values())).all():
        raise ValueError("a time that is not finite")
    log10_nfa = float(cells[NFA_COLUMN]) if cells.get(NFA_COLUMN) else None
    return TrackResult(
        status=status, cam_from_world=pose, covariance=covariance, stage_ms=stage_ms, **counts, log10_nfa=log10_nfa
    )


def _cell(value: float | int | None) -> str:
    return "" if value is None else repr(value)


def _write_csv(path: Path, columns: list[str], rows: list[list[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
