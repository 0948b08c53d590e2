"""Finds and reads the trajectory of a file, folder or bag, with its format, declared frame and covariances."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.reports.metrics.quaternions import conjugate, multiply, normalized, rotate
from uavbench.scenes.dataset.ground_truth_files import MOUNTS_FILE
from uavbench.scenes.dataset.table_files import read_integers, read_json, read_numbers, read_table
from uavbench.trajectories.bags.poses import read_poses
from uavbench.trajectories.bags.reading import BagTopic, bag_topic
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import TRAJECTORY
from uavbench.trajectories.files.tables import column_names, line_of_row, plain_number
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.trajectory import InvalidRowError, Trajectory
from uavbench.trajectories.trajectory_files.covariances import COLUMNS, PoseCovariances
from uavbench.trajectories.trajectory_files.export_description import description_of
from uavbench.trajectories.trajectory_files.formats import (
    declared_frame,
    guess_format,
    read_covariant_tum,
    read_trajectory,
)
from uavbench.trajectories.trajectory_files.number_lines import Layout, read_lines

POSE = ["px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz"]
"""Pose columns of uavbench's tables: `world_from_body`, or a tracker's `cam_from_world` in tables with a `status`."""
IN_FOLDERS = (
    "groundtruth.csv",
    "estimate_world_from_body.tum",
    "estimate_world_from_cam.tum",
    "mav0/state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0/data.csv",
    "data.csv",
    "groundtruth.txt",
    "poses.txt",
)
"""Trajectory files by which a folder is searched: of a sequence, of results, of an export to EuRoC, TUM or KITTI."""
OF_BODY = ("euroc", "mcap", "rosbag2")
"""Exports whose poses have the stamps of the body's clock; those of others have the stamps of the images."""
BAGS = ("bag.mcap", "bag")
"""Names of the bag in an export to MCAP or rosbag2."""
ROUNDING_S = 1e-3
"""Most by which a time in s may differ from its stamp in ns: many programs write milliseconds, or cut them off."""
CAMERAS = "cameras"
"""Folder of a sequence that holds those of its further cameras, and their table in sequence.json."""


class Clock(NamedTuple):
    """Whether stamps are those of the body's clock or of its cameras', and by how much they differ, as far as is known.

    shift_ns: t_body = t_cameras + shift, as in Kalibr; 0 where it is not recorded.
    """

    of_body: bool
    shift_ns: int


@dataclass(frozen=True)
class Found:
    """A trajectory with its file and format.

    frame: declared frame such as `world_from_body`, None if the file declares none; for a bag `?` replaces a frame that
    the messages do not name. stamped: whether the stamps are times and not row numbers. covariances: of the poses, if
    the file has any. asked_ns: stamps of all frames that a tracker was given, with and without a pose, where its
    frames.csv says so. camera: name of the camera whose poses they are, None if no export declares it; optical: the
    name before `_optical_frame` of a frame in a bag; clock: that of the stamps, None where no record tells it.
    """

    trajectory: Trajectory
    file: Path
    format: str
    frame: str | None
    stamped: bool = True
    covariances: PoseCovariances | None = None
    asked_ns: NDArray[np.int64] | None = None
    camera: str | None = None
    optical: str = ""
    clock: Clock | None = None

    def seen_as(self, frame: str, cam_from_body: Pose) -> "Found":
        """The trajectory converted to another moving frame, body or camera; frame: as in `world_from_cam`."""
        if self.frame == frame:
            return self
        right = cam_from_body if frame.endswith("_from_body") else cam_from_body.inverse()
        given, claimed = self.trajectory, self.covariances
        q = normalized(given.quaternions_wxyz)
        moved = Trajectory(
            given.stamps_ns,
            given.positions_m + rotate(q, np.tile(right.translation, (len(given), 1))),
            multiply(q, right.quaternion_wxyz[None]),
        )
        return replace(self, trajectory=moved, frame=frame, covariances=claimed and claimed.moved(right, q))


def find_trajectory(path: Path, format: str | None = None) -> Found:
    """Trajectory of a file, of a topic of a bag (`bag.mcap:/odom`), or of a folder that holds one.

    The format is detected unless it is given. UserError naming the file when it is invalid or holds no trajectory.
    """
    if format in (None, "bag") and (bag := _bag(path)) is not None:
        poses, (_, main, clock) = read_poses(bag), _exported(bag.bag)
        found = Found(poses.trajectory, Path(str(poses.source)), "bag", poses.frame, covariances=poses.covariances)
        named = poses.camera if main is None or poses.camera != MAIN else main
        return replace(found, camera=named if main and named else None, optical=named, clock=clock)
    file = _in_folder(path) if path.is_dir() else path
    return _with_frames_beside(_of_file(file, format), claims=path.is_dir())


def _of_file(file: Path, format: str | None) -> Found:
    if format == "uavbench" or (format is None and _is_table(file)):
        return replace(_of_table(file), clock=_own_clock(file))
    found, declared = _of_rows(file, format or guess_format(file)), _exported(file)
    camera = declared.camera if (found.frame or "").endswith("_from_cam") else None
    return replace(found, camera=camera, clock=declared.clock or _own_clock(file))


def _of_rows(file: Path, name: str) -> Found:
    frame = declared_frame(file) or _exported(file).frame
    if name == "tum":
        tum = read_covariant_tum(file)
        return Found(tum.trajectory, file, name, frame, covariances=tum.covariances)
    trajectory, _ = read_trajectory(file, name)
    if name != "kitti":
        return Found(trajectory, file, name, frame)
    stamps = _kitti_stamps(file, len(trajectory))
    if stamps is None:
        return Found(trajectory, file, name, frame, stamped=False)
    return Found(Trajectory(stamps, trajectory.positions_m, trajectory.quaternions_wxyz), file, name, frame)


def mount_of(folder: Path, of: Found | None = None) -> Pose:
    """`cam_from_body` of a sequence folder, of that of one of its cameras, or of a tracker's results.

    of: the poses to convert; those of a further camera have its mount. UserError when it is missing or invalid.
    """
    place = folder.resolve()
    further = place.parent.name == CAMERAS and not (place / "sequence.json").is_file()
    above = place.parent.parent if further else folder
    file = next((above / name for name in ("sequence.json", "record.json") if (above / name).is_file()), None)
    if file is None:
        raise UserError(f"{folder}: holds neither sequence.json nor record.json, which describe the camera's mounting")
    about = read_json(file)
    others = about.get(CAMERAS)
    tables = {MAIN: about, **(others if isinstance(others, dict) else {})}
    declared = of.camera if of else None
    name = place.name if further else declared or (of.optical if of and of.optical in tables else MAIN)
    if of and (name not in tables or declared not in (None, name)):
        raise UserError(
            f"{of.file} has the poses of the camera {declared or name!r}, whose mount {folder} does not have; name the "
            "folder of the sequence with this camera"
        )
    found = tables.get(name, {})
    if found.get("cam_from_body") == MOUNTS_FILE:
        raise UserError(
            f"{file}: the camera is on a gimbal, so no one mount converts its poses to those of the body; compare "
            "poses of the camera: export the sequence to tum, or take the groundtruth_world_from_cam.tum of its results"
        )
    try:
        return Pose.from_matrix(found["cam_from_body"])
    except (KeyError, ValueError, TypeError) as error:
        raise UserError(f"{file}: cam_from_body: {error}") from None


def _bag(path: Path) -> BagTopic | None:
    """The bag at a path, or in the folder of an export; None if there is none."""
    exported = [path / name for name in BAGS if path.is_dir() and (path / name).exists()]
    return next((bag for place in (path, *exported) if (bag := bag_topic(place)) is not None), None)


def _in_folder(folder: Path) -> Path:
    for name in IN_FOLDERS:
        if (folder / name).is_file():
            return folder / name
    raise UserError(
        f"{folder}: this folder holds no trajectory of a known name ({', '.join(IN_FOLDERS)}); name the file itself"
    )


def _is_table(path: Path) -> bool:
    """Whether a file begins with the header of one of uavbench's tables."""
    try:
        return "stamp_ns" in column_names(path, TRAJECTORY)
    except UserError:
        return False  # `read_trajectory` raises the error


def _of_table(path: Path) -> Found:
    """Trajectory of groundtruth.csv, flight.csv or a tracker's frames.csv."""
    rows = read_table(path, ["stamp_ns"])
    columns = list(rows[0]) if rows else []
    if not rows or any(name not in columns for name in POSE):
        raise UserError(f"{path}: holds no poses (columns {', '.join(POSE)}), but {', '.join(columns) or 'nothing'}")
    stamps = read_integers(path, ["stamp_ns"])[:, 0]
    if "status" not in columns:
        _check_file_seconds(path, stamps, np.ones(len(rows), dtype=bool), columns)
        values, frame = read_numbers(path, POSE), "world_from_body"
        try:
            return Found(Trajectory(stamps, values[:, :3], values[:, 3:]), path, "uavbench", frame)
        except InvalidRowError as error:
            raise UserError(f"{path}: line {line_of_row(path, error.row)}: {error.what}") from None
    ok = [row["status"].strip() == "ok" for row in rows]
    if not any(ok):
        raise UserError(f"{path}: holds no pose: no frame has the status ok")
    kept = [row for row, good in zip(rows, ok, strict=True) if good]
    _check_file_seconds(path, stamps, np.array(ok), columns)
    try:
        cameras = np.array([[plain_number(row[name]) for name in POSE] for row in kept])
        trajectory = world_from_cameras(stamps[np.array(ok)], cameras)
        claimed = _claimed(kept) if set(columns) >= set(COLUMNS) else None
    except InvalidRowError as error:
        row = int(np.flatnonzero(ok)[error.row])
        raise UserError(f"{path}: line {line_of_row(path, row)}: {error.what}") from None
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    return Found(trajectory, path, "uavbench", "world_from_cam", covariances=claimed, asked_ns=stamps)


def check_seconds(stamps_ns: NDArray[np.int64], time_s: Array, used: NDArray[np.bool_]) -> None:
    """InvalidRowError where times (n,) in s are not those of the stamps (n,) in ns, nor counted from the first of them.

    used: the rows (n,) with a pose, which alone are compared. Times may be counted from the first of these, too, and
    rounded, by ROUNDING_S and to 64 bits.
    """
    seconds = np.asarray(stamps_ns, dtype=np.float64) / 1e9
    zeros = (0.0, seconds[0], seconds[np.argmax(used)])
    far = [used & ~(np.abs(time_s - (seconds - zero)) <= ROUNDING_S + np.spacing(seconds)) for zero in zeros]
    if (fewest := min(far, key=np.count_nonzero)).any():
        row = int(np.argmax(fewest))
        raise InvalidRowError(
            row, f"stamp_ns {stamps_ns[row]} and time_s {time_s[row]:.9g} differ; leave out the column that is wrong"
        )


def _check_file_seconds(path: Path, stamps_ns: NDArray[np.int64], used: NDArray[np.bool_], columns: list[str]) -> None:
    """UserError naming the line where a table's column time_s, if it has one, differs from its stamps; used: rows."""
    if "time_s" not in columns:
        return
    try:
        check_seconds(stamps_ns, read_numbers(path, ["time_s"])[:, 0], used)
    except InvalidRowError as error:
        raise UserError(f"{path}: line {line_of_row(path, error.row)}: {error.what}") from None


def world_from_cameras(stamps_ns: NDArray[np.int64], cameras: Array) -> Trajectory:
    """Trajectory `world_from_cam` of rows (n, 7) of `cam_from_world`, position first; ValueError for an invalid row."""
    given = Trajectory(stamps_ns, cameras[:, :3], cameras[:, 3:])
    back = conjugate(normalized(given.quaternions_wxyz))
    return Trajectory(stamps_ns, -rotate(back, given.positions_m), back)


def _claimed(rows: list[dict[str, str]]) -> PoseCovariances | None:
    """Covariances of `cam_from_world` in a tracker's rows, blank for rows without one."""
    table = np.array([[plain_number(row[name] or "nan") for name in COLUMNS] for row in rows])
    return PoseCovariances.of_columns(table, "moving")


def _with_frames_beside(found: Found, *, claims: bool) -> Found:
    """A tracker's trajectory with the frames of the frames.csv beside it, and with its covariances if `claims`."""
    table = found.file.with_name("frames.csv")
    if not (
        found.file.name.startswith("estimate_") and table.is_file() and "status" in column_names(table, TRAJECTORY)
    ):
        return found
    beside = _of_table(table)
    if not np.array_equal(beside.trajectory.stamps_ns, found.trajectory.stamps_ns):
        return found
    found = replace(found, asked_ns=beside.asked_ns)
    if not claims or beside.covariances is None or found.covariances is not None:
        return found
    if found.frame is not None and found.frame != beside.frame:
        beside = beside.seen_as(found.frame, mount_of(found.file.parent))
    return replace(found, covariances=beside.covariances)


class Declared(NamedTuple):
    """What an export.json declares of a file: the frame of its poses, the camera of the images, and its clock."""

    frame: str | None = None
    camera: str | None = None
    clock: Clock | None = None


def _exported(file: Path) -> Declared:
    """What an export declares of one of its files; nothing of other files."""
    description = description_of(file)
    if description is None:
        return Declared()
    about = read_json(description)
    frames, camera = about.get("frames", {}), about.get("camera")
    files = frames if isinstance(frames, dict) else {}
    name = file.resolve().relative_to(description.parent).as_posix()
    said = next((files[each] for each in (name, f"{name}/bag.db3") if each in files), None)
    if not isinstance(said, str):
        return Declared()
    clock = Clock(about.get("format") in OF_BODY, _shift_ns(about))
    return Declared(said, camera if isinstance(camera, str) else None, clock)


def _own_clock(file: Path) -> Clock | None:
    """Clock of a file in the folder of a sequence, of one of its cameras, or of results; None for other files."""
    for record in (file.with_name("sequence.json"), file.parent.parent.parent / "sequence.json"):
        if record.is_file() and file.name in ("groundtruth.csv", "flight.csv"):
            return Clock(file.name == "flight.csv", _shift_ns(read_json(record)))
    of_results = file.name == "frames.csv" or file.name.startswith(("estimate_", "groundtruth_"))
    return Clock(of_body=False, shift_ns=0) if of_results and file.with_name("record.json").is_file() else None


def _shift_ns(about: dict[str, Any]) -> int:
    """The offset of the cameras' clock in a record; 0 if there is none."""
    shift_ns = about.get("timeshift_cam_imu_ns", 0)
    return shift_ns if isinstance(shift_ns, int) else 0


def _kitti_stamps(file: Path, count: int) -> np.ndarray | None:
    """Stamps in ns of the times.txt beside KITTI poses; None without that file. UserError naming an invalid line."""
    times = file.with_name("times.txt")
    if file.name == "times.txt" or not times.is_file():
        return None
    lines = read_lines(times, Layout(1, unit_ns=10**9))
    if len(lines.stamps_ns) != count:
        raise UserError(f"{times}: has {len(lines.stamps_ns)} times for the {count} poses of {file}")
    late = np.flatnonzero(np.diff(lines.stamps_ns) <= 0)
    if len(late):
        raise UserError(f"{times}: line {lines.numbers[late[0] + 1]}: its time is not later than the previous one")
    return lines.stamps_ns
