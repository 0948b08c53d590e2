"""Parser of the rows that an external tracker prints, with named faults.

A row is `stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz`, optionally followed by the 21 numbers of the upper triangle of
the covariance, row by row. The pose is `cam_from_world`. The statuses `lost`, `ambiguous` and `not_initialized` are
followed by nothing.
"""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from uavbench.tracker.protocol import Status, TrackResult
from uavbench.tracker.results import COVARIANCE_COLUMNS, POSE_COLUMNS, UPPER
from uavbench.trajectories.errors import UserError, one_line
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M, FileLimit
from uavbench.trajectories.files.reading import opened
from uavbench.trajectories.files.tables import plain_number
from uavbench.trajectories.pose import Array, Pose

POSE_HEADER = ["stamp_ns", "status", *POSE_COLUMNS]
HEADERS = [POSE_HEADER, [*POSE_HEADER, *COVARIANCE_COLUMNS]]
STATUSES: tuple[Status, ...] = get_args(Status)
MOST_ROW_BYTES = 4096
"""Longest row in bytes; 30 numbers of 26 characters, the longest ones in use, take 780."""
MOST_FAULTS = 10_000
"""Most faults of a run that are listed; the rest are counted."""

FAULTS = {
    "cannot-start": "check that the program exists, is executable, and finds its libraries",
    "not-ready": "print the line `ready` on standard output and flush it once the tracker can receive frames",
    "crashed": "its error output is in stderr.txt of the job folder, which `check` and `track` keep; flights do not",
    "out-of-memory": "use less memory, or raise memory_mb, the limit for all of its processes together",
    "hung": "answer every frame, and flush standard output after each line; or raise timeout_s",
    "no-output": "write estimates.csv in the current folder",
    "malformed": "write stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz, numbers with a decimal point",
    "not-finite": "a frame without a good pose has the status `lost`",
    "too-many": "correct the first ones",
    "bad-rotation": "write a unit quaternion, w first",
    "bad-covariance": "write the upper triangle of a symmetric, positive semi-definite 6x6 matrix by rows",
    "unknown-stamp": "repeat the stamp of the frame that the row belongs to",
    "duplicate": "write one row for each frame",
    "missing": "write one row for each frame; one without a pose has the status `lost`",
    "out-of-order": "write the rows in the order of the frames",
    "unasked": "print one line for each frame, after receiving it, and nothing else on standard output",
}
"""Name of each fault -> its remedy."""
ROW_FAULTS = ("not-finite", "bad-rotation", "bad-covariance")
"""Faults that cost one frame, after which program and benchmark remain synchronized."""


@dataclass(frozen=True)
class Fault:
    """A fault: its name in FAULTS, the row or frame, and what is wrong, as one line of plain text."""

    name: str
    where: str
    what: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "where", one_line(self.where))
        object.__setattr__(self, "what", one_line(self.what))

    def __str__(self) -> str:
        return f"[{self.name}] {self.where}: {self.what}; {FAULTS[self.name]}"


class TrackerFault(UserError):
    """An external tracker violated the protocol."""

    def __init__(self, name: str, where: str, what: str) -> None:
        self.fault = Fault(name, where, what)
        super().__init__(str(self.fault))

    def __reduce__(self) -> tuple[type["TrackerFault"], tuple[str, str, str]]:
        return type(self), (self.fault.name, self.fault.where, self.fault.what)


class EstimateRow(NamedTuple):
    """A row's stamp, and the result of the frame with this stamp."""

    stamp_ns: int
    result: TrackResult


class Estimates(NamedTuple):
    """Result of each frame, in the order of the frames, and the faults of the rows."""

    results: list[TrackResult]
    faults: list[Fault]


def read_row(text: str, where: str) -> EstimateRow:
    """Stamp and result of a row; TrackerFault when it is malformed, not finite or not a valid pose."""
    cells = [cell.strip() for cell in text.strip().split(",")]
    try:
        if len(cells[0]) > 20 or "_" in cells[0]:  # 64 bits and a sign; Python reads 1_5 as 15
            raise ValueError
        stamp_ns = int(cells[0])
    except ValueError:
        raise TrackerFault("malformed", where, f"{_short(text)} does not begin with an integer stamp") from None
    status = next((s for s in STATUSES if len(cells) > 1 and cells[1] == s), None)
    if status is None:
        raise TrackerFault("malformed", where, f"the status in {_short(text)} is none of {', '.join(STATUSES)}")
    values = cells[2:]
    if status != "ok":
        if any(values):
            raise TrackerFault("malformed", where, f"a frame that is {status} has no pose, but numbers follow")
        return EstimateRow(stamp_ns, TrackResult(status=status))
    while len(values) > len(POSE_COLUMNS) and not any(values[len(POSE_COLUMNS) :]):
        values = values[: len(POSE_COLUMNS)]
    if len(values) not in (7, 28):
        raise TrackerFault("malformed", where, f"{len(values)} numbers after `ok`, not 7 (pose) or 28 (and covariance)")
    try:
        numbers = np.array([plain_number(value) for value in values])
    except ValueError as error:
        raise TrackerFault("malformed", where, str(error)[:120]) from None
    if not np.isfinite(numbers).all():
        raise TrackerFault("not-finite", where, f"{_short(text)} holds a number that is not finite")
    if not np.abs(numbers[:3]).max() <= LARGEST_COORDINATE_M:
        raise TrackerFault("not-finite", where, f"{_short(text)} has a position beyond {LARGEST_COORDINATE_M:g} m")
    if not abs(float(np.linalg.norm(numbers[3:7])) - 1) < 1e-3:
        raise TrackerFault("bad-rotation", where, f"the quaternion has norm {np.linalg.norm(numbers[3:7]):.6g}, not 1")
    pose = Pose.from_quaternion(numbers[3:7], numbers[:3])
    result = TrackResult(status="ok", cam_from_world=pose, covariance=_covariance(numbers[7:], where))
    return EstimateRow(stamp_ns, result)


def read_estimates(path: Path, stamps_ns: Sequence[int]) -> Estimates:
    """Result of each frame and all faults of an `estimates.csv`; frames with a missing or faulty row are lost.

    Of several rows for one frame the first is used.
    """
    limit = FileLimit("file of estimates", MOST_ROW_BYTES * (len(stamps_ns) + 2), "write one row for each frame")
    try:
        if path.is_symlink() or not path.exists():
            return Estimates(_lost(stamps_ns), [Fault("no-output", path.name, "there is no such file")])
        with opened(path, limit, inside=path.parent) as handle:
            return _read(path, io.TextIOWrapper(handle, encoding="utf-8-sig"), stamps_ns)
    except (OSError, UnicodeDecodeError, UserError) as error:
        reason = str(error).removeprefix(f"{path}: ")
        return Estimates(_lost(stamps_ns), [Fault("malformed", path.name, f"not readable as UTF-8 text: {reason}")])


def _read(path: Path, lines: io.TextIOWrapper, stamps_ns: Sequence[int]) -> Estimates:
    header = lines.readline(MOST_ROW_BYTES)
    if [cell.strip() for cell in header.split(",")] not in HEADERS:
        fault = Fault("malformed", path.name, f"the first line must be {','.join(POSE_HEADER)}")
        return Estimates(_lost(stamps_ns), [fault])
    row_of = {stamp: row for row, stamp in enumerate(stamps_ns)}
    results: dict[int, TrackResult] = {}
    named: set[int] = set()
    faults: list[Fault] = []
    latest = -1
    more = 0
    for number, line in enumerate(_rows(lines), start=2):
        if not line.strip():
            continue
        where = f"{path.name} line {number}"
        row = _row_named(line, row_of)
        try:
            if row in named:
                raise TrackerFault("duplicate", where, f"a row for stamp {stamps_ns[row]} was given before")
            if row is not None:
                named.add(row)
            stamp, result = read_row(line, where)
            if row is None:
                raise TrackerFault("unknown-stamp", where, f"no frame has the stamp {stamp}")
            results[row] = result
            if row < latest:
                raise TrackerFault("out-of-order", where, f"stamp {stamp} comes after {stamps_ns[latest]}")
            latest = row
        except TrackerFault as error:
            if len(faults) < MOST_FAULTS:
                faults.append(error.fault)
            else:
                more += 1
    missing = [(stamp, row) for stamp, row in row_of.items() if row not in named]
    room = MOST_FAULTS - len(faults)
    faults += [
        Fault("missing", path.name, f"there is no row for frame {row} (stamp {stamp})") for stamp, row in missing[:room]
    ]
    more += len(missing[room:])
    if more:
        faults.append(Fault("too-many", path.name, f"and {more:,} more faults"))
    return Estimates([results.get(row, TrackResult(status="lost")) for row in range(len(stamps_ns))], faults)


def _rows(lines: io.TextIOWrapper) -> Iterator[str]:
    """Lines of a file; an overlong line is split into pieces, none of which is a valid row."""
    while line := lines.readline(MOST_ROW_BYTES):
        yield line


def _row_named(line: str, row_of: dict[int, int]) -> int | None:
    try:
        return row_of.get(int(line.split(",", 1)[0][:21]))
    except ValueError:
        return None


def _covariance(upper: Array, where: str) -> Array | None:
    if not len(upper):
        return None
    if not np.abs(upper).max() <= LARGEST_COORDINATE_M**2:
        raise TrackerFault("bad-covariance", where, f"the covariance has a number beyond {LARGEST_COORDINATE_M**2:g}")
    covariance = np.zeros((6, 6))
    covariance[UPPER] = upper
    covariance = covariance + np.triu(covariance, 1).T
    values = np.linalg.eigvalsh(covariance)
    if not values[0] >= -1e-9 * abs(values[-1]):
        raise TrackerFault("bad-covariance", where, f"the covariance has the eigenvalue {values[0]:.3g}")
    return covariance


def _lost(stamps_ns: Sequence[int]) -> list[TrackResult]:
    return [TrackResult(status="lost")] * len(stamps_ns)


def _short(text: str) -> str:
    text = text.strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")
