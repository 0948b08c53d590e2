"""Try a tracker on a tiny sequence and explain every fault: `uavbench check TRACKER.toml`."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from uavbench.bench.external.program import External, track_external
from uavbench.bench.third_party.tracker import ThirdPartyTracker
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.results import Results
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.processes.guard import Guard

TRIAL = Path(__file__).parent / "sequence"
CLOSE_M, CLOSE_DEG = 0.15, 10.0
"""Median error above which other conventions are tried; repeating the initial pose is more accurate than this."""
FAR_M, FAR_DEG = 0.6, 45.0
"""Largest error in frame 0, whose true pose the tracker is given; `lsd-single` has 0.49 m and 25 deg."""
RIGHT = "cam_from_world, metres, w first, OpenCV axes, in the world of the model"


def check(tracker: Tracker, kept_folder: Path) -> Iterator[str]:
    """Run a tracker on the tiny sequence and yield findings as lines; the last begins with `good` or `faulty`.

    kept_folder: copy of the job folder of an external tracker. UserError when a third-party tracker is unavailable.
    """
    sequence = Sequence.load(TRIAL)
    rate_hz = float(sequence.info["rate_hz"])
    yield f"{len(sequence)} frames of {sequence.camera.width} x {sequence.camera.height} px at {rate_hz:g} Hz"
    first = _run(tracker, sequence, rate_hz, kept_folder)
    faults = list(first.record["errors"])
    yield from faults
    if faults and isinstance(tracker, External | ThirdPartyTracker):
        yield f"its job folder: {kept_folder}"
    yield first.summary
    yield from _accuracy(first, sequence)
    mistaken = _mistaken(first, sequence)
    astray = "" if mistaken else _astray(first, sequence)
    if mistaken:
        yield f"[convention] the poses are right if read as {mistaken}; write {RIGHT}"
    if astray:
        yield f"[first-pose] {astray}, and no known convention makes it right; write {RIGHT}"
    if times := [row.stage_ms["total"] for row in first.rows if "total" in row.stage_ms]:
        yield f"time per frame: median {np.median(times):.2f} ms, worst {max(times):.2f} ms"
    if not faults:
        with Guard("uavbench-again-") as scratch:
            again = _run(tracker, sequence, rate_hz, scratch.folder / "again")
        same = all(_same(a.cam_from_world, b.cam_from_world) for a, b in zip(first.rows, again.rows, strict=True))
        program = isinstance(tracker, External | ThirdPartyTracker)
        remedy = (
            "seed it from job.toml" if program else "take all random numbers from `rng`, keep no state between runs"
        )
        yield "a second run gave the same poses" if same else f"note: a second run gave other poses; {remedy}"
    yield "faulty" if faults or mistaken or astray else "good: the tracker follows the protocol"


def _run(tracker: Tracker, sequence: Sequence, rate_hz: float, kept_folder: Path) -> Results:
    if isinstance(tracker, ThirdPartyTracker):
        return _run(tracker.present(), sequence, rate_hz, kept_folder)
    if isinstance(tracker, External):
        return track_external(tracker, sequence, rate_hz=rate_hz, seed=0, kept_folder=kept_folder)
    return track_sequence(tracker, sequence, rate_hz=rate_hz, seed=0)


def _accuracy(results: Results, sequence: Sequence) -> Iterator[str]:
    """A line with the median error; no line without a pose."""
    if pairs := _pairs(results, sequence):
        metres, degrees = _median_error(pairs, AS_IT_IS, sequence)
        yield f"median error: {metres * 100:.2f} cm, {degrees:.2f} deg"


def _mistaken(results: Results, sequence: Sequence) -> str:
    """The simplest convention that makes inaccurate poses accurate; "" if none does, or none is needed."""
    pairs = _pairs(results, sequence)
    if not pairs or _is_close(*_median_error(pairs, AS_IT_IS, sequence)):
        return ""
    close = (reading for reading in READINGS if _is_close(*_median_error(pairs, reading, sequence)))
    return str(next(close, ""))


def _astray(results: Results, sequence: Sequence) -> str:
    """Error of the pose of frame 0 against the initial pose given for it; "" within FAR_M and FAR_DEG."""
    row = results.rows[0] if len(results) and results.frames[0] == 0 else None
    if row is None or row.cam_from_world is None:
        return ""
    metres, degrees = _error(row.cam_from_world, sequence.true_cam_from_world(0))
    if metres <= FAR_M and degrees <= FAR_DEG:
        return ""
    return f"frame 0: {metres * 100:.1f} cm and {degrees:.1f} deg from the pose that `start` gave for it"


def _pairs(results: Results, sequence: Sequence) -> list[tuple[Pose, Pose]]:
    """Estimated and true cam_from_world of the frames with a pose."""
    return [
        (row.cam_from_world, sequence.true_cam_from_world(frame))
        for frame, row in zip(results.frames.tolist(), results.rows, strict=True)
        if row.cam_from_world is not None
    ]


def _median_error(pairs: list[tuple[Pose, Pose]], reading: "Reading", sequence: Sequence) -> tuple[float, float]:
    """Median distance in m and median angle in deg of poses read by a convention."""
    errors = [_error(reading.of(estimate, sequence.cam_from_body), ground_truth) for estimate, ground_truth in pairs]
    metres, degrees = np.median(errors, axis=0).tolist()
    return metres, degrees


def _is_close(metres: float, degrees: float) -> bool:
    return metres <= CLOSE_M and degrees <= CLOSE_DEG


def _error(estimate: Pose, ground_truth: Pose) -> tuple[float, float]:
    """Distance of the camera centres in m and angle in deg between two cam_from_world."""
    metres = np.linalg.norm(estimate.inverse().translation - ground_truth.inverse().translation)
    return float(metres), float(np.degrees(np.linalg.norm((estimate @ ground_truth.inverse()).log()[3:])))


def _same(a: Pose | None, b: Pose | None) -> bool:
    return a is None if b is None else a is not None and bool(np.array_equal(a.matrix, b.matrix))


FLIP = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""Rotation between OpenGL's camera axes (y up, z back) and OpenCV's (y down, z forward); its own inverse."""
Unit = Literal["", "millimetres", "centimetres", "feet"]
Part = Literal["", "rotation", "translation"]
PARTS: tuple[Part, ...] = get_args(Part)
UNITS: dict[Unit, float] = {"": 1.0, "millimetres": 1e-3, "centimetres": 1e-2, "feet": 0.3048}
"""Metres per unit."""
World = Literal["", "y up", "z down, x kept", "z down, x and y swapped"]
WORLDS: dict[World, Pose] = {
    "": Pose.identity(),
    "y up": Pose(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3)),
    "z down, x kept": Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)),
    "z down, x and y swapped": Pose(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.zeros(3)),
}
"""From the world to y-up worlds of computer graphics, to forward-right-down, and from east-north-up to NED."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A pose convention that a tracker may have used by mistake.

    w_last: quaternions xyzw; inverse: world_from_cam; mixed: the part that is taken from world_from_cam, the other from
    cam_from_world; opengl: camera axes y up, z back; of_body: the pose of the body.
    """

    w_last: bool = False
    unit: Unit = ""
    inverse: bool = False
    mixed: Part = ""
    opengl: bool = False
    of_body: bool = False
    world: World = ""

    def of(self, written: Pose, cam_from_body: Pose) -> Pose:
        """The cam_from_world in our convention, translation in m, of a pose written in this one."""
        pose = Pose(written.rotation, written.translation * UNITS[self.unit])
        if self.w_last:
            w, x, y, z = pose.quaternion_wxyz
            # what was written as x y z w was read as w x y z
            pose = Pose.from_quaternion([z, w, x, y], pose.translation)
        if self.mixed == "rotation":
            pose = Pose(pose.rotation.T, pose.translation)
        elif self.mixed == "translation":
            pose = Pose(pose.rotation, -pose.rotation @ pose.translation)
        pose = (pose.inverse() if self.inverse else pose) @ WORLDS[self.world]
        pose = FLIP @ pose if self.opengl else pose
        return cam_from_body @ pose if self.of_body else pose

    def __str__(self) -> str:
        source = "body" if self.of_body else "cam"
        words = [
            f"world_from_{source}" if self.inverse else "body_from_world" if self.of_body else "",
            f"cam_from_world with the {self.mixed} of world_from_cam" if self.mixed else "",
            "OpenGL axes (y up, z back)" if self.opengl else "",
            self.unit,
            f"a world with {self.world}" if self.world else "",
            "quaternions with w last" if self.w_last else "",
        ]
        return ", ".join(word for word in words if word)

    @property
    def strangeness(self) -> int:
        """Number of conventions that differ from ours."""
        return sum(map(bool, (self.w_last, self.unit, self.inverse, self.mixed, self.opengl, self.of_body, self.world)))


AS_IT_IS = Reading()
READINGS = sorted(
    (
        Reading(w_last=w_last, unit=unit, inverse=inverse, mixed=mixed, opengl=opengl, of_body=of_body, world=world)
        for w_last, unit, inverse, mixed, opengl, of_body, world in product(
            (False, True), UNITS, (False, True), PARTS, (False, True), (False, True), WORLDS
        )
        if not (opengl and of_body) and not (mixed and inverse)
    ),
    key=lambda reading: reading.strangeness,
)[1:]
"""Every other convention, fewest differences first."""
