"""Run a tracker over a sequence."""

import hashlib
import inspect
import json
import time
from collections.abc import Callable, Mapping
from copy import copy, deepcopy
from dataclasses import Field, fields, is_dataclass, replace
from enum import Enum
from pathlib import PurePath
from typing import Any, NamedTuple, cast

import numpy as np

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body, Feed, Samples, body_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.structure import Structure
from uavbench.tracker.faults import checked, fault_message, is_ours
from uavbench.tracker.initialization import Initialization, Known, initial_pose_of
from uavbench.tracker.protocol import Image, Prediction, Run, Tracker, TrackResult
from uavbench.tracker.registry import tracker_kind
from uavbench.tracker.results import Results, cam_from_evaluated
from uavbench.tracker.versions import versions
from uavbench.trajectories.errors import Terminated, UserError, one_line
from uavbench.trajectories.files.limits import LARGEST_COORDINATE_M
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.processes.forked import ending_what_forked_off
from uavbench.trajectories.random_streams import stream

KNOWN = Known()
OnFrame = Callable[[int, TrackResult], None]
SAME_RATE = 0.01
"""Relative difference below which two rates count as one: 29.97 Hz is called 30."""
JITTERED = 0.5
"""Relative difference below which stamps may have the rate of their record, with jitter; those of a twin of each second
frame have half of it."""
NEAR_RATE = 0.1
"""Relative difference below which a stride may be called by a rate, as 3.75 Hz by 4; 7.5 Hz are not called 10."""


def track_sequence(
    tracker: Tracker,
    sequence: Sequence,
    *,
    rate_hz: float,
    seed: int,
    on_frame: OnFrame | None = None,
    start: Initialization = KNOWN,
) -> Results:
    """Results of a tracker on every k-th frame, k the sequence's rate over rate_hz, from the initial pose of `start`.

    `on_frame(frame, result)` is called after each frame. A frame for which the tracker raises an exception or returns
    an invalid result is `lost` and listed under `errors` of the record. Reading images is not timed. UserError when the
    tracker cannot be started, rate_hz is out of range or an image cannot be read.
    """
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz))
    first = initial_pose(start, sequence, 0, seed)
    feed = Feed(sequence)
    run = begin(tracker, sequence, first, tracker_stream(tracker, seed), feed.body)
    errors: list[str] = []
    rows: list[TrackResult] = []
    for frame in frames.tolist():
        image, stamp_ns = sequence.image(frame), int(sequence.stamps_ns[frame])
        result, error = track_frame(run, image, stamp_ns, feed.upto(stamp_ns))
        if error:
            errors.append(f"frame {frame}: {error}")
        rows.append(result)
        if on_frame is not None:
            on_frame(frame, result)
    record = make_record(tracker, sequence, rate_hz=rate_hz, seed=seed, errors=errors, start=start)
    return Results(record, frames, sequence.stamps_ns[frames], tuple(rows))


def begin(
    tracker: Tracker, sequence: Sequence, cam_from_world: Pose, rng: np.random.Generator, body: Body | None = None
) -> Run:
    """Start a run of a tracker over a sequence from a pose; the body is passed to `start` if it has a parameter `body`.

    UserError naming the place in the tracker's code when `start` raises or does not return a run.
    """
    tracker = own_copy(tracker)
    return started(tracker, sequence.structure, sequence.camera, cam_from_world, rng, body or body_of(sequence))


def started(
    tracker: Tracker,
    structure: Structure,
    camera: Camera,
    cam_from_world: Pose,
    rng: np.random.Generator,
    body: Body,
) -> Run:
    """Start a run of a tracker without a sequence; UserError as `begin`."""
    more = {"body": body} if "body" in inspect.signature(tracker.start).parameters else {}
    try:
        with ending_what_forked_off():
            run = tracker.start(structure, camera, cam_from_world, rng, **more)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt | Terminated) or is_ours(tracker):
            raise
        raise UserError(f"{tracker_kind(tracker)} cannot be started: {fault_message(error, tracker.start)}") from error
    if not callable(getattr(run, "track", None)):
        what = one_line(repr(run))[:60]
        raise UserError(f"{tracker_kind(tracker)}: start returned {what}, which has no method `track`")
    return run


def own_copy(tracker: Any) -> Any:
    """The tracker with parameters of its own: what a run writes to them is in no record, and in no other run."""
    own = copy(tracker)
    for f in _given(tracker):
        object.__setattr__(own, f.name, deepcopy(getattr(tracker, f.name)))
    return own


def tracker_stream(tracker: Tracker, seed: int, *names: str | int) -> np.random.Generator:
    """Random generator of a tracker: its own stream, which does not reveal the sequence's seed."""
    drawn = stream(seed, "tracker", tracker_kind(tracker), *names)
    hidden = stream(seed, "tracker", tracker_kind(tracker), *names, "own seed").integers(2**63)
    bits = np.random.PCG64(int(hidden))
    bits.state = cast(Any, drawn.bit_generator.state)
    return np.random.Generator(bits)


def all_failed(results: Results) -> str:
    """Message with the first fault if the tracker failed and no frame has a pose, else ""."""
    errors = results.record["errors"]
    if not errors or results.ok.any():
        return ""
    return f"the tracker failed on all of its {len(results)} frames; first: {errors[0]}"


def initial_pose(start: Initialization, sequence: Sequence, frame: int, seed: int) -> Pose:
    """cam_from_world with which a tracker is started at a frame of a sequence."""
    names = ("initialization",) if frame == 0 else ("initialization", str(frame))
    pose = sequence.true_cam_from_world(frame) if frame else sequence.initial_cam_from_world
    rng = stream(seed, *names)
    return initial_pose_of(start, sequence.structure, sequence.camera, pose, sequence.image(frame), rng)


class TrackedFrame(NamedTuple):
    """The result of a frame, and the tracker's fault, "" without one."""

    result: TrackResult
    error: str


def track_frame(
    run: Run,
    image: Image,
    stamp_ns: int,
    samples: Mapping[str, Samples] | None = None,
    expected: Prediction | None = None,
) -> TrackedFrame:
    """Result of one frame with its `total` wall-clock time in stage_ms, and the tracker's fault, "" without one.

    samples: measurements of the body's sensors since the previous frame, for a run with `sense`; expected: prediction
    of the vehicle's filter, for a run with `predict`.
    """
    error, own = "", np.array(image)  # a copy: a tracker may write into what it gets
    sense = getattr(run, "sense", None) if samples is not None else None
    predict = getattr(run, "predict", None) if expected is not None else None
    method = sense or predict or run.track
    begin = time.perf_counter()
    try:
        with ending_what_forked_off():
            if sense is not None:
                sense(samples)
            if predict is not None and expected is not None:
                method = predict
                predict(expected.cam_from_world, expected.covariance)
            method = run.track
            result = run.track(own, stamp_ns)
        total_ms = (time.perf_counter() - begin) * 1e3
        result = checked(result)
    except (KeyboardInterrupt, Terminated):
        raise
    except BaseException as exception:  # a user's tracker may raise anything: its frame is lost, the run continues
        total_ms = (time.perf_counter() - begin) * 1e3
        result, error = TrackResult(status="lost"), fault_message(exception, method)
    if result.cam_from_world is not None and not within_reach(result.cam_from_world):
        result = TrackResult(status="lost", stage_ms=result.stage_ms)
        error = f"its pose is not finite or beyond {LARGEST_COORDINATE_M:g} m"
    return TrackedFrame(replace(result, stage_ms={"total": total_ms, **_stages(result)}), error)


def _stages(result: TrackResult) -> dict[str, float]:
    """Times of a tracker's own stages, ms: the total is what was measured, whatever it calls so."""
    return {name: ms for name, ms in result.stage_ms.items() if name != "total"}


def within_reach(pose: Pose) -> bool:
    """Whether a pose is finite and within LARGEST_COORDINATE_M, so that its errors can be computed."""
    return bool(np.isfinite(pose.rotation).all() and np.abs(pose.translation).max() <= LARGEST_COORDINATE_M)


def stride(sequence: Sequence, rate_hz: float) -> int:
    """Stride of the frames of a sequence that is nearest to rate_hz; UserError as `nearest_stride`.

    Stamps have the rate of the record also where the link lost most frames, but for some that follow each other.
    """
    told_hz = float(sequence.info.get("rate_hz", 0.0))
    steps_ns = np.diff(sequence.stamps_ns)
    stamped_hz = 1e9 / float(np.median(steps_ns)) if len(sequence) > 1 else told_hz or rate_hz
    shortest = told_hz * float(steps_ns.min()) / 1e9 if len(sequence) > 1 else 1.0
    of_record = told_hz / stamped_hz > 1 - JITTERED and shortest < 1 + JITTERED
    try:
        return nearest_stride(told_hz if of_record else stamped_hz, rate_hz, sequence.name)
    except UserError as error:
        raise UserError(f"rate_hz: {error}") from None


def nearest_stride(sequence_hz: float, rate_hz: float, name: str) -> int:
    """Stride of the frames of a sequence of a name and rate that is nearest to rate_hz.

    UserError for a rate that is not positive, or above that of the sequence by more than SAME_RATE.
    """
    if not rate_hz > 0:
        raise UserError(f"{rate_hz:g} Hz: the rate must be positive")
    if rate_hz > sequence_hz * (1 + SAME_RATE):
        raise UserError(f"{rate_hz:g} Hz is more than the {sequence_hz:g} Hz of sequence {name}")
    return max(1, round(min(sequence_hz / rate_hz, 1e9)))


def whole_stride(sequence_hz: float, rate_hz: float, name: str) -> int:
    """The nearest stride; UserError as there, and for a rate that no stride has to within NEAR_RATE."""
    step = nearest_stride(sequence_hz, rate_hz, name)
    if abs(sequence_hz / (step * rate_hz) - 1) > NEAR_RATE:
        below = int(sequence_hz / rate_hz)
        raise UserError(
            f"{rate_hz:g} Hz: sequence {name} has {sequence_hz:g} Hz, of which every k-th frame is tracked, k a whole "
            f"number; choose {sequence_hz / below:g} or {sequence_hz / (below + 1):g} Hz"
        )
    return step


def make_record(
    tracker: Tracker,
    sequence: Sequence,
    *,
    rate_hz: float,
    seed: int,
    errors: list[str],
    start: Initialization = KNOWN,
) -> dict[str, Any]:
    """Content of `record.json` of a run; its `content_hash` covers all inputs."""
    inputs = {
        "start": {"kind": type(start).__name__, "parameters": parameters(start)},
        "sequence": {"name": sequence.name, "content_hash": sequence.content_hash},
    }
    return record_of(tracker, inputs, cam_from_evaluated(sequence), rate_hz=rate_hz, seed=seed, errors=errors)


def record_of(
    tracker: Tracker, inputs: Mapping[str, Any], cam_from_body: Pose, *, rate_hz: float, seed: int, errors: list[str]
) -> dict[str, Any]:
    """Record of a tracker on any inputs, given as JSON values by name, which enter the content hash."""
    made_by = {
        **inputs,
        "tracker": {"kind": tracker_kind(tracker), "parameters": parameters(tracker)},
        "rate_hz": rate_hz,
        "seed": seed,
        "versions": versions(),
    }
    return {
        **made_by,
        "cam_from_body": cam_from_body.matrix.tolist(),
        "errors": errors,
        "content_hash": hashlib.sha256(json.dumps(made_by, sort_keys=True).encode()).hexdigest(),
    }


def parameters(tracker: Any) -> dict[str, Any]:
    """Parameters of a tracker by name, as JSON values; not what it computes of them (`field(init=False)`)."""
    return {f.name: plain(getattr(tracker, f.name)) for f in _given(tracker)}


def _given(tracker: Any) -> list[Field[Any]]:
    """Fields of a tracker that are set by whoever makes it."""
    its = fields(tracker) if is_dataclass(tracker) and not isinstance(tracker, type) else ()
    return [f for f in its if f.init and hasattr(tracker, f.name)]


def plain(value: Any) -> Any:
    """JSON value of a parameter: text of a path, value of an enumeration, lists of arrays and, in order, of sets.

    UserError for one of any other type.
    """
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, np.generic | Enum)):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return parameters(value)
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(plain, value)) if type(value) in (list, tuple) else [*map(plain, value)]
    if isinstance(value, set | frozenset):
        return sorted(map(plain, value), key=repr)
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, PurePath):
        return str(value)
    raise UserError(
        f"is of type {type(value).__name__}, which no record can hold; give numbers, texts, or lists or tables of "
        "them, and make all else of them in `start`"
    )
