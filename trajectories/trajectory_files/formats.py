"""Trajectory files: TUM, EuRoC and KITTI, with numbers that round-trip exactly.

tum     `t tx ty tz qx qy qz qw`, seconds, space-separated (TUM RGB-D benchmark), with an optional covariance behind
        (of OpenVINS's twelve numbers nothing is used)
euroc   `ns,px,py,pz,qw,qx,qy,qz,...`, comma-separated with a # header (EuRoC ASL ground truth)
kitti   12 numbers a row, the upper 3 x 4 of the pose matrix; no stamps (KITTI odometry); the number of the row, counted
        from 0, may stand before them

The frames are declared by a comment `# frame: world_from_body` at the top of a file, or by the same words in its name;
capitals, blanks and hyphens are other spellings of the same.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uavbench.trajectories.errors import UserError, one_line, unknown_name
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M
from uavbench.trajectories.files.writing import write_text
from uavbench.trajectories.pose import Array, quaternion_from_rotation
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.covariances import CovariantTrajectory, PoseCovariances
from uavbench.trajectories.trajectory_files.named_columns import check_named_columns
from uavbench.trajectories.trajectory_files.number_lines import (
    Layout,
    NumberLines,
    cells_of,
    column_advice,
    comments,
    first_lines,
    read_lines,
    separator_advice,
    whole_number,
)

KITTI_RATE_HZ = 10.0
"""Rate of the KITTI odometry sequences."""
LEAST_NS_STEP = 1000
"""Integer stamps at least this far apart are read as nanoseconds, not seconds."""
SHOWN = 40
"""Most characters of an unknown frame that an error message quotes."""
TUM_VALUES, KITTI_VALUES = 8, 12
OPENVINS_VALUES = TUM_VALUES + 12
"""Values per line of OpenVINS: a pose, then the upper triangles of the covariances of rotation and position."""
COVARIANT_TUM_VALUES = (TUM_VALUES + 21, TUM_VALUES + 36)
"""Values per line whose pose is followed by its covariance: the upper triangle by rows, or the full matrix."""
FRAME_COMMENT = re.compile(r"^[ \t]*(?:#|%|//)[#%/ \t]*frame[ \t]*[:=][ \t]*([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
FRAME = re.compile(r"([a-z]\w*?)[-_ \t]+from[-_ \t]+([a-z]\w*)", re.IGNORECASE)
MEANT = re.compile(r"(?<![a-z])(?:from|to|body|cam|camera|T)(?![a-z])", re.IGNORECASE)
"""A word by which a comment says of what the poses are; without one, as in `# frame: map`, it tells a fixed frame."""
FRAME_NAME = re.compile(r"(?<![a-z])world_from_(?:body|cam)(?![a-z])", re.IGNORECASE)


class TrajectoryFile(NamedTuple):
    """Content of a trajectory file, and the name of its format."""

    trajectory: Trajectory
    format: str


def read_trajectory(path: Path, format: str | None = None) -> TrajectoryFile:
    """Trajectory of a file, whose format is guessed from its first lines unless given.

    UserError naming the file, the line and what is wrong with it.
    """
    name = format or guess_format(path)
    if name not in READERS:
        raise unknown_name("trajectory format", name, list(READERS))
    return TrajectoryFile(READERS[name](path), name)


def guess_format(path: Path) -> str:
    """Name of the format that a file's first lines of numbers match; UserError when they match none.

    Eight numbers or more are euroc if the first one counts nanoseconds: a whole number that grows by at least
    LEAST_NS_STEP, or has at least twelve digits. Twelve with spaces between them are kitti in any case.
    """
    (number, line), *second = first_lines(path, 2)
    cells = cells_of(line)
    stamped = len(cells) >= 8 and _in_nanoseconds([cells[0], *(cells_of(text)[0] for _, text in second)])
    if len(cells) == KITTI_VALUES and not (stamped and "," in line):
        return "kitti"
    if len(cells) == 1 + KITTI_VALUES and [cells[0], *(cells_of(text)[0] for _, text in second)] in (["0", "1"], ["0"]):
        return "kitti"
    if stamped:
        return "euroc"
    if len(cells) in (TUM_VALUES, OPENVINS_VALUES, *COVARIANT_TUM_VALUES):
        return "tum"
    raise UserError(
        f"{path}: line {number} has {len(cells)} values, so it is neither tum (8, or 29 or 44 with a covariance), "
        "kitti (12) nor euroc (8 or more, integer nanoseconds first)"
        f"{separator_advice(line) or column_advice(len(cells))}"
    )


def declared_frame(path: Path) -> str | None:
    """Frame that a trajectory file declares, such as `world_from_body`, in its first comments or its name.

    None if it declares none, as a comment of other programs that names the fixed frame alone; UserError when comment
    and name differ, and for a comment that tells of what the poses are in words that are not read.
    """
    said = [_frame_of(path, text) for text in FRAME_COMMENT.findall(comments(path)) if MEANT.search(text)]
    named = [name.lower() for name in FRAME_NAME.findall(path.name)]
    found = list(dict.fromkeys([*said, *named]))
    if len(found) > 1:
        raise UserError(f"{path}: declares {' and '.join(found)}; correct its `# frame:` or its name")
    return found[0] if found else None


def _frame_of(path: Path, text: str) -> str:
    """Frames in the one spelling that is compared, such as `world_from_cam`; UserError for a text that names none."""
    found = FRAME.fullmatch(text.strip("`'\" \t"))
    if found is None:
        raise UserError(
            f"{path}: its comment declares the frame {one_line(text.strip())[:SHOWN]!r}, which does not say of what "
            "the poses are; write `# frame: world_from_body` or `# frame: world_from_cam`, or remove the comment"
        )
    fixed, moving = (name.lower() for name in found.groups())
    return f"{fixed}_from_{'cam' if moving == 'camera' else moving}"


def read_tum(path: Path) -> Trajectory:
    """Trajectory of a TUM file; seconds become integer nanoseconds digit by digit. UserError naming the line."""
    return read_covariant_tum(path).trajectory


def read_covariant_tum(path: Path) -> CovariantTrajectory:
    """The same with the covariances that may follow the poses, in world axes, position first."""
    check_named_columns(path, comments(path), "tum")
    width = len(cells_of(first_lines(path, 1)[0][1]))
    known = (*COVARIANT_TUM_VALUES, OPENVINS_VALUES)
    lines = read_lines(path, Layout(width if width in known else TUM_VALUES, unit_ns=10**9))
    trajectory = _trajectory(path, lines, lines.values[:, 1:4], lines.values[:, [7, 4, 5, 6]])
    claimed = lines.values[:, TUM_VALUES : width if width in COVARIANT_TUM_VALUES else TUM_VALUES]
    return CovariantTrajectory(trajectory, PoseCovariances.of_columns(claimed, "fixed") if claimed.size else None)


def read_euroc(path: Path) -> Trajectory:
    """Trajectory of an EuRoC ground-truth file; columns after the quaternion are ignored. UserError naming the line."""
    check_named_columns(path, comments(path), "euroc")
    lines = read_lines(path, Layout(8, more=True, unit_ns=1))
    _check_unit(path, lines)
    return _trajectory(path, lines, lines.values[:, 1:4], lines.values[:, 4:8])


def read_kitti(path: Path, rate_hz: float = KITTI_RATE_HZ) -> Trajectory:
    """Trajectory of a KITTI file, which has no stamps: row k is at k / rate_hz seconds. UserError naming the line.

    Rows may begin with their number, counted from 0.
    """
    numbered = len(cells_of(first_lines(path, 1)[0].text)) == 1 + KITTI_VALUES
    lines = read_lines(path, Layout(KITTI_VALUES + numbered))
    if numbered:
        _check_count(path, lines)
    matrices = lines.values[:, -KITTI_VALUES:].reshape(-1, 3, 4)
    R = matrices[:, :, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2))
        bad = ~((off < 1e-3) & (np.linalg.det(R) > 0))
    if bad.any():
        raise UserError(
            f"{path}: line {lines.numbers[int(np.argmax(bad))]}: its first three columns are not a rotation (1e-3)"
        )
    stamps = np.array([round(i * 10**9 / rate_hz) for i in range(len(matrices))], dtype=np.int64)
    return _trajectory(path, replace(lines, stamps_ns=stamps), matrices[:, :, 3], quaternion_from_rotation(R))


def _check_count(path: Path, lines: NumberLines) -> None:
    """UserError for the first line that does not begin with its number, counted from 0."""
    off = np.flatnonzero(lines.values[:, 0] != np.arange(len(lines.numbers)))
    if off.size:
        row = int(off[0])
        raise UserError(
            f"{path}: line {lines.numbers[row]} begins with {lines.values[row, 0]:.9g}, and its pose is number {row}, "
            "counted from 0: poses are compared row by row. Where it is a time, move the column to a times.txt beside "
            "the file; where poses are missing, write those that there are with their times, as tum"
        )


def write_tum(trajectory: Trajectory, path: Path, frame: str = "") -> None:
    """Write a TUM file: seconds with nine decimals, so that the stamps read back exactly.

    frame: what the poses map, such as `world_from_body`; written as a comment, which readers of the format skip.
    """
    head = f"# frame: {frame}\n# timestamp_s tx_m ty_m tz_m qx qy qz qw\n" if frame else ""
    rows = zip(
        trajectory.stamps_ns.tolist(),
        trajectory.positions_m.tolist(),
        trajectory.quaternions_wxyz[:, [1, 2, 3, 0]].tolist(),
        strict=True,
    )
    write_text(path, head + "".join(f"{seconds(ns)} {_join(' ', p)} {_join(' ', q)}\n" for ns, p, q in rows))


def write_euroc(trajectory: Trajectory, path: Path, motion: Array | None = None) -> None:
    """Write an EuRoC ground-truth file; `motion` (n, 3 or 9) adds velocity in the world, then biases (gyro, accel)."""
    header = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    table = np.column_stack([trajectory.positions_m, trajectory.quaternions_wxyz])
    if motion is not None:
        header += ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"
        if motion.shape[1] > 3:
            header += "".join(f", b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz")
            header += "".join(f", b_a_RS_S_{axis} [m s^-2]" for axis in "xyz")
        table = np.column_stack([table, motion])
    rows = zip(trajectory.stamps_ns.tolist(), table.tolist(), strict=True)
    write_text(path, header + "\n" + "".join(f"{ns},{_join(',', row)}\n" for ns, row in rows))


def write_kitti(trajectory: Trajectory, path: Path) -> None:
    """Write a KITTI file; the format has no stamps."""
    rows = np.concatenate([trajectory.rotations, trajectory.positions_m[:, :, None]], axis=2).reshape(-1, 12)
    write_text(path, "".join(f"{_join(' ', row)}\n" for row in rows.tolist()))


def seconds(stamp_ns: int) -> str:
    """Stamp in seconds with nine decimals, exactly."""
    whole, rest = divmod(abs(stamp_ns), 10**9)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{rest:09d}"


def _in_nanoseconds(texts: list[str]) -> bool:
    """Whether stamps are whole numbers, also as `1.5e9` or `15.0`, which count nanoseconds by their size or step."""
    stamps = [whole_number(text) for text in texts]
    if stamps[0] is None or stamps[-1] is None:
        return False
    return len(str(abs(stamps[0]))) >= 12 or stamps[-1] - stamps[0] >= LEAST_NS_STEP


def _check_unit(path: Path, lines: NumberLines) -> None:
    """UserError for stamps with decimals that step by less than LEAST_NS_STEP: they are not nanoseconds."""
    steps = np.diff(lines.values[:, 0])
    if np.any(lines.values[:, 0] % 1) and len(steps) and (step := np.median(steps)) < LEAST_NS_STEP:
        raise UserError(
            f"{path}: its stamps have decimals and step by {step:.6g}, and those of euroc are integer nanoseconds; "
            "multiply seconds by 1e9"
        )


def _trajectory(path: Path, lines: NumberLines, positions: Array, quaternions: Array) -> Trajectory:
    """Trajectory of parsed columns; UserError naming the line of the first bad pose."""
    stamps = lines.stamps_ns
    try:
        trajectory = Trajectory(stamps, positions, quaternions)
        if max(positions.max(), -positions.min()) <= LARGEST_COORDINATE_M:
            return trajectory
    except ValueError:
        pass
    with np.errstate(invalid="ignore", over="ignore"):
        norms = np.linalg.norm(quaternions, axis=1)
    for what, bad in (
        ("its position is not finite", ~np.isfinite(positions).all(axis=1)),
        (
            f"its position is beyond {LARGEST_COORDINATE_M:g} m; is it in metres?",
            np.abs(positions).max(axis=1) > LARGEST_COORDINATE_M,
        ),
        ("its quaternion is not of unit norm (1e-3)", ~(np.abs(norms - 1) < 1e-3)),
        (
            "its time stamp is not later than the previous one; sort the file",
            np.concatenate([[False], stamps[1:] < stamps[:-1]]),
        ),
        (
            "its time stamp is not later than the previous one, but the same; leave one of the two lines out",
            np.concatenate([[False], stamps[1:] == stamps[:-1]]),
        ),
    ):
        if bad.any():
            raise UserError(f"{path}: line {lines.numbers[int(np.argmax(bad))]}: {what}")
    raise AssertionError("a trajectory is rejected for one of these reasons")


def _join(separator: str, row: list[float]) -> str:
    return separator.join(map(repr, row))


READERS: dict[str, Callable[[Path], Trajectory]] = {"tum": read_tum, "euroc": read_euroc, "kitti": read_kitti}
WRITERS: dict[str, Callable[[Trajectory, Path], None]] = {
    "tum": write_tum,
    "euroc": write_euroc,
    "kitti": write_kitti,
}
