"""Try a tracker on a tiny sequence and explain every fault: `uavbench check TRACKER.toml`."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.external import External, track_external
from bench.peers.peer import Peer
from scenes.sequence import Sequence
from tracker.base import Tracker
from tracker.results import Results
from tracker.run import track_sequence
from trajectories.pose import Pose

TRIAL = Path(__file__).parent / "trial" / "sequence"
CLOSE_M, CLOSE_DEG = 0.15, 10.0
"""Poses off by more than this, where even the first pose repeated is closer, may be written by another convention."""


def check(tracker: Tracker, kept_folder: Path) -> Iterator[str]:
    """Lines that say how a tracker does on the tiny sequence; the last begins with `good` or `faulty`."""
    sequence = Sequence.load(TRIAL)
    rate_hz = float(sequence.info["rate_hz"])
    yield f"{len(sequence)} frames of {sequence.camera.width} x {sequence.camera.height} px at {rate_hz:g} Hz"
    first = _run(tracker, sequence, rate_hz, kept_folder)
    faults = list(first.record["errors"])
    yield from faults
    if faults and isinstance(tracker, External | Peer):
        yield f"its job folder: {kept_folder}"
    yield f"frames with a pose: {int(first.ok.sum())} of {len(first)}"
    yield from _accuracy(first, sequence)
    if times := [row.stage_ms["total"] for row in first.rows if "total" in row.stage_ms]:
        yield f"time per frame: median {np.median(times):.2f} ms, worst {max(times):.2f} ms"
    if not faults:
        with tempfile.TemporaryDirectory() as scratch:
            again = _run(tracker, sequence, rate_hz, Path(scratch) / "again")
        same = all(_same(a.cam_from_world, b.cam_from_world) for a, b in zip(first.rows, again.rows, strict=True))
        yield (
            "a second run gave the same poses" if same else "note: a second run gave other poses; seed it from job.toml"
        )
    yield "faulty" if faults else "good: the protocol is kept"


def _run(tracker: Tracker, sequence: Sequence, rate_hz: float, kept_folder: Path) -> Results:
    if isinstance(tracker, Peer):
        return _run(tracker.present(), sequence, rate_hz, kept_folder)
    if isinstance(tracker, External):
        return track_external(tracker, sequence, rate_hz=rate_hz, seed=0, kept_folder=kept_folder)
    return track_sequence(tracker, sequence, rate_hz=rate_hz, seed=0)


def _accuracy(results: Results, sequence: Sequence) -> Iterator[str]:
    """The median error, and what the poses look like when they are far off."""
    pairs = [
        (row.cam_from_world, sequence.true_cam_from_world(frame))
        for frame, row in zip(results.frames.tolist(), results.rows, strict=True)
        if row.cam_from_world is not None
    ]
    if not pairs:
        return
    metres, degrees = (float(v) for v in np.median([_error(a, b) for a, b in pairs], axis=0))
    yield f"median error: {metres * 100:.2f} cm, {degrees:.2f} deg"
    if not (metres <= CLOSE_M and degrees <= CLOSE_DEG):
        for name, reading in READINGS.items():
            m, d = (float(v) for v in np.median([_error(reading(a), b) for a, b in pairs], axis=0))
            if m <= CLOSE_M and d <= CLOSE_DEG:
                yield f"note: the poses are right if read as {name}; write cam_from_world, metres, w first, OpenCV axes"


def _error(estimate: Pose, truth: Pose) -> tuple[float, float]:
    """Distance of the camera centres in m and angle in degrees."""
    metres = np.linalg.norm(estimate.inverse().translation - truth.inverse().translation)
    return float(metres), float(np.degrees(np.linalg.norm((estimate @ truth.inverse()).log()[3:])))


def _same(a: Pose | None, b: Pose | None) -> bool:
    return a is None if b is None else a is not None and bool(np.array_equal(a.matrix, b.matrix))


def _xyzw(pose: Pose) -> Pose:
    w, x, y, z = pose.quaternion_wxyz
    # what was written as x y z w was read as w x y z
    return Pose.from_quaternion([z, w, x, y], pose.translation)


FLIP = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
READINGS: dict[str, Callable[[Pose], Pose]] = {
    "world_from_cam": lambda pose: pose.inverse(),
    "quaternions with w last": _xyzw,
    "world_from_cam with w last": lambda pose: _xyzw(pose).inverse(),
    "OpenGL axes (y up, z back)": lambda pose: FLIP @ pose,
    "world_from_cam in OpenGL axes": lambda pose: FLIP @ pose.inverse(),
    "millimetres": lambda pose: Pose(pose.rotation, pose.translation / 1000),
    "centimetres": lambda pose: Pose(pose.rotation, pose.translation / 100),
}
