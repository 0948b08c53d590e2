"""Poses in one file of a submission, frame by frame; invalid content becomes named faults and lost frames."""

import os
import stat
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.challenge.submission import Fault
from uavbench.bench.external.rows import read_estimates
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MB
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import declared_frame, read_trajectory

LARGEST_TUM_BYTES = 64 * MB
"""Largest TUM file, bytes; an hour of poses at 100 Hz, 128 bytes each, takes 46 million."""
MOST_STAMP_DIFFERENCE_NS = 10_000_000
"""Largest difference between the stamps of a TUM pose and its frame; evo's default, below half a frame interval."""
FRAMES = ("world_from_cam", "world_from_body")
"""Reference frames that a TUM file may declare for its poses; the first is the default."""

Rows = tuple[TrackResult, ...]


@dataclass(frozen=True)
class Frames:
    """The frames of a sequence to be located: their stamps (n,) in ns, and the camera's mounting."""

    stamps_ns: NDArray[np.int64]
    cam_from_body: Pose

    @property
    def lost(self) -> Rows:
        """Results in which every frame is lost."""
        return (TrackResult(status="lost"),) * len(self.stamps_ns)


class SubmittedPoses(NamedTuple):
    """Result of each frame, in the order of the frames, and the faults of the file."""

    rows: Rows
    faults: list[Fault]


def read_submitted(path: Path, where: str, frames: Frames) -> SubmittedPoses:
    """Read the results in a file of a submission; where: name of the file in faults. Never raises."""
    try:
        if path.parent.is_symlink() or not stat.S_ISREG(os.lstat(path).st_mode):
            raise UserError("is a link, behind a link, or no regular file")
        return (_of_tum if path.suffix == ".tum" else _of_csv)(path, where, frames)
    except UserError as error:
        return SubmittedPoses(frames.lost, [Fault("unreadable", where, str(error).removeprefix(f"{path}: "))])
    except OSError as error:
        return SubmittedPoses(frames.lost, [Fault("unreadable", where, error.strerror or str(error))])


def _of_csv(path: Path, where: str, frames: Frames) -> SubmittedPoses:
    rows, found = read_estimates(path, frames.stamps_ns.tolist())
    counts = Counter(fault.name for fault in found)
    first = {fault.name: fault for fault in reversed(found)}
    faults = [
        Fault("bad-rows", where, f"{count} {name}, the first at {first[name].where}: {first[name].what}")
        for name, count in sorted(counts.items())
    ]
    return SubmittedPoses(tuple(rows), faults)


def _of_tum(path: Path, where: str, frames: Frames) -> SubmittedPoses:
    size = path.stat().st_size
    if size > LARGEST_TUM_BYTES:
        raise UserError(f"has {size:,} bytes; a trajectory of one sequence has at most {LARGEST_TUM_BYTES:,}")
    trajectory, _ = read_trajectory(path, "tum")
    frame = declared_frame(path) or FRAMES[0]
    if frame not in FRAMES:
        raise UserError(f"declares the frame {frame}; expected {' or '.join(FRAMES)}")
    nearest = _nearest(trajectory.stamps_ns, frames.stamps_ns)
    if (nearest < 0).all():
        ms = MOST_STAMP_DIFFERENCE_NS / 1e6
        what = f"no frame is within {ms:g} ms of one of its {len(trajectory)} poses; {_spans(trajectory, frames)}"
        return SubmittedPoses(frames.lost, [Fault("no-frame", where, what)])
    mount = frames.cam_from_body if frame == "world_from_body" else Pose.identity()
    rows = tuple(
        TrackResult(status="ok", cam_from_world=mount @ trajectory.pose(row).inverse())
        if row >= 0
        else TrackResult(status="lost")
        for row in nearest.tolist()
    )
    missing = int((nearest < 0).sum())
    what = f"{missing} of {len(nearest)} frames have no pose; {_spans(trajectory, frames)}"
    return SubmittedPoses(rows, [Fault("bad-rows", where, what)] if missing else [])


def _spans(trajectory: Trajectory, frames: Frames) -> str:
    """Which seconds the poses of a file and the frames span, which shows stamps in another unit."""
    given, wanted = (f"{s[0] / 1e9:.10g} to {s[-1] / 1e9:.10g} s" for s in (trajectory.stamps_ns, frames.stamps_ns))
    return f"its stamps are {given}, those of the frames {wanted}"


def _nearest(given_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row (n,) of the given stamp nearest to each wanted one; -1 where none is within the tolerance."""
    after = np.searchsorted(given_ns, wanted_ns).clip(0, len(given_ns) - 1)
    before = (after - 1).clip(0)
    rows = np.where(abs(given_ns[before] - wanted_ns) <= abs(given_ns[after] - wanted_ns), before, after)
    least = int(np.diff(wanted_ns).min()) if len(wanted_ns) > 1 else 2 * MOST_STAMP_DIFFERENCE_NS
    near = abs(given_ns[rows] - wanted_ns) < min(MOST_STAMP_DIFFERENCE_NS + 1, (least + 1) // 2)
    return np.where(near, rows, -1)
