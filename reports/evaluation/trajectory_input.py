"""Trajectories given by a script as a path, a `Trajectory`, an array or a DataFrame."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uavbench.reports.evaluation.find_trajectory import (
    POSE,
    Found,
    check_seconds,
    find_trajectory,
    world_from_cameras,
)
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array
from uavbench.trajectories.trajectory import InvalidRowError, Trajectory
from uavbench.trajectories.trajectory_files.covariances import COLUMNS, PoseCovariances

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from pandas import DataFrame

    Given = Path | str | Trajectory | NDArray[Any] | DataFrame
else:
    Given = Any

STAMPS = ("stamp_ns", "time_s")
"""Columns of a DataFrame that hold the time, in integer nanoseconds or in seconds."""
WANTED = f"stamp_ns (integers) or time_s, and {', '.join(POSE)}"


def found_in(given: Given, side: str, format: str | None = None) -> Found:
    """Trajectory of a path, a Trajectory, an array or a DataFrame; `side` names it in errors.

    array (n, 8): time in s, position x y z in m, quaternion x y z w, as in a line of a TUM file. DataFrame: columns
    stamp_ns or time_s, px_m py_m pz_m, qw qx qy qz; with a column `status`, as in a tracker's frames.csv, the poses are
    `cam_from_world`, and those whose status is not ok are left out. With both columns of time stamp_ns counts, and they
    must agree. Quaternions must have unit norm (to 1e-3), stamps must increase. format: of a file. UserError naming the
    side and the invalid row or column.
    """
    if isinstance(given, str | Path):
        return find_trajectory(Path(given), format)
    if format is not None:
        raise UserError(
            f"the {side}: {side}_format = {format!r} is of a file, and no file is given; leave it out, and give arrays "
            "(n, 8) of time_s, x y z in m, qx qy qz qw"
        )
    try:
        if isinstance(given, Trajectory):
            return Found(given, Path(f"the {side}"), "Trajectory", None)
        if hasattr(given, "columns"):
            return _of_table(given, Path(f"the {side}"))
        return Found(_of_array(given), Path(f"the {side}"), "array", None)
    except (ValueError, TypeError) as error:
        raise UserError(f"the {side}: {error}") from None


def name_of(given: Given, side: str) -> str:
    """Name in error messages: the path if one was given, else the side."""
    return str(given) if isinstance(given, str | Path) else f"the {side}"


def _of_array(given: Any) -> Trajectory:
    if hasattr(given, "ground_truth"):
        raise ValueError("is a sequence; give its `ground_truth`, the poses of the body, or its folder")
    if np.ma.is_masked(given):
        raise ValueError("has masked values; leave their rows out")
    if np.iscomplexobj(given):
        raise ValueError("holds complex numbers")
    values = np.asarray(given, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 8 or not len(values):
        raise ValueError(f"has the shape {values.shape}; give (n, 8): time_s, x y z in m, qx qy qz qw")
    return Trajectory(_nanoseconds(values[:, 0]), values[:, 1:4], values[:, [7, 4, 5, 6]])


def _of_table(table: Any, name: Path) -> Found:
    stamp = next((name for name in STAMPS if name in table.columns), None)
    missing = [name for name in POSE if name not in table.columns]
    if stamp is None or missing or not len(table):
        have = f"it has {', '.join(map(str, table.columns))}" if len(table) else "it has no rows"
        raise ValueError(f"a DataFrame of poses has the columns {WANTED}; {have}")
    tracked = "status" in table.columns
    used = (table["status"] == "ok").to_numpy(dtype=bool) if tracked else np.ones(len(table), dtype=bool)
    rows = table[used]
    if not len(rows):
        raise ValueError("holds no pose: no row has the status ok")
    if any(np.iscomplexobj(rows[name]) for name in POSE):
        raise ValueError("holds complex numbers")
    values = rows[POSE].to_numpy(dtype=np.float64)
    stamps_ns = _stamps_ns(rows, stamp)
    if stamp == "stamp_ns" and "time_s" in table.columns:
        check_seconds(_stamps_ns(table, stamp), _seconds(table), used)
    if not tracked:
        return Found(Trajectory(stamps_ns, values[:, :3], values[:, 3:]), name, "DataFrame", None)
    claimed = None
    if all(column in table.columns for column in COLUMNS):
        claimed = PoseCovariances.of_columns(rows[COLUMNS].to_numpy(dtype=np.float64), "moving")
    try:
        trajectory = world_from_cameras(stamps_ns, values)
    except InvalidRowError as error:
        raise InvalidRowError(int(np.flatnonzero(used)[error.row]), error.what) from None
    found = Found(trajectory, name, "DataFrame", "world_from_cam", covariances=claimed)
    return replace(found, asked_ns=_stamps_ns(table, stamp))


def _stamps_ns(table: Any, column: str) -> "NDArray[np.int64]":
    """Stamps (n,) in ns of a column of STAMPS; ValueError naming the first invalid row."""
    return table[column].to_numpy() if column == "stamp_ns" else _nanoseconds(_seconds(table))


def _seconds(table: Any) -> Array:
    """The column time_s (n,) as numbers; ValueError for dates and time differences."""
    given = table["time_s"].to_numpy()
    if given.dtype.kind in "mM":
        raise ValueError(
            f"time_s has the type {given.dtype}; give seconds, or stamp_ns = "
            "table['time_s'].to_numpy().astype('datetime64[ns]').astype('int64')"
        )
    return np.asarray(given, dtype=np.float64)


def _nanoseconds(seconds: Array) -> "NDArray[np.int64]":
    """Stamps (n,) in ns of times (n,) in s; ValueError naming the first invalid row."""
    bad = ~(np.abs(seconds) < 9e9)  # 2^63 ns
    if bad.any():
        raise ValueError(f"row {int(np.argmax(bad))}: {seconds[bad][0]} is not a time in seconds")
    return np.rint(seconds * 1e9).astype(np.int64)
