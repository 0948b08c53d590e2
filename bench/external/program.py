"""External trackers: programs in any language that get a folder or a stream of frames, never the ground truth.

In the folder form the program gets all frames at once and writes `estimates.csv`. In the stream form it prints `ready`,
gets one frame at a time on standard input and answers each with one line, so that it cannot use later frames and its
latency is measured here. docs/external-trackers.md specifies the protocol.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from uavbench.bench.external.isolation import THREADS, refuse_seen, usable
from uavbench.bench.external.job_folder import job_folder, sample_lines, write_frames, write_job, write_sensors
from uavbench.bench.external.kept_folder import keep
from uavbench.bench.external.process import Process
from uavbench.bench.external.rows import ROW_FAULTS, Estimates, Fault, TrackerFault, read_estimates, read_row
from uavbench.bench.inputs.command_files import command_files, run_files
from uavbench.bench.inputs.program_kernels import kernels_of_program
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import Body, Feed, Samples
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.structure import Structure
from uavbench.tracker.faults import is_ours
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Image, Run, Tracker, TrackResult
from uavbench.tracker.results import UPPER, Results
from uavbench.tracker.run import KNOWN, initial_pose, make_record, stride, tracker_stream
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.processes.guard import Guard

OnFrame = Callable[[int, TrackResult], None]
MAX_FAULTS_REPORTED = 20
EXPECTED = "expected"
"""First word of the line with the filter's predicted camera pose."""
LONGEST_S = 86_400.0
"""Longest timeout, s: a day; `poll` counts milliseconds in 31 bits, at most 24 days."""
MOST_MB = 1 << 27
"""128 TiB in MB, the address space of a process on x86-64 Linux; a larger limit has no effect."""


@dataclass(frozen=True, kw_only=True)
class External:
    """A program of your own, in any language, as a tracker.

    command: program and arguments, without a shell; relative names of files beside the config are resolved there. mode:
    `stream` sends one frame at a time, `folder` all at once. pixels: format of the streamed images. timeout_s: for one
    frame, or for the whole folder; start_timeout_s: until `ready`. memory_mb: limit of the address space of each
    process, and of their total memory. input_files: further files whose change makes its results stale (sources,
    weights). isolate: only the system, these files and the job folder are visible to it
    (`uavbench.bench.external.isolation`).
    """

    command: Annotated[tuple[str, ...], MinLen(1)]
    mode: Literal["stream", "folder"] = "stream"
    pixels: Literal["bgr", "grey"] = "bgr"
    timeout_s: Annotated[float, Gt(0), Le(LONGEST_S)] = 60.0
    start_timeout_s: Annotated[float, Gt(0), Le(LONGEST_S)] = 60.0
    memory_mb: Annotated[int, Ge(16), Le(MOST_MB)] = 8192
    input_files: tuple[str, ...] = ()
    isolate: bool = False

    def __post_init__(self) -> None:
        for name in self.input_files:
            if not Path(name).is_file():
                raise ValueError(f"input_files: {name} is not a file")

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content is hashed into every result: the command's, input_files, and the protocol's modules."""
        own = sorted(Path(__file__).parent.glob("*.py"))
        return (*own, *command_files(self.command), *map(Path, self.input_files))

    @property
    def entering_variables(self) -> tuple[str, ...]:
        """Variables passed on whose values are hashed into every result; the paths among the others count by files."""
        return THREADS

    @property
    def seen_files(self) -> tuple[Path, ...]:
        """Files visible to the isolated program: those that its command names, their imports, and input_files."""
        return (*run_files(self.command), *map(Path, self.input_files))

    def run(self, guard: Guard) -> Process:
        """The program, running in the folder of a guard."""
        files = self.seen_files if self.isolate else None
        kernels = None if self.isolate else kernels_of_program(run_files(self.command), lambda: self.entering_files)
        piped = self.mode == "stream"
        return Process(self.command, guard, memory_mb=self.memory_mb, piped=piped, files=files, kernels=kernels)

    def start(
        self,
        structure: Structure,
        camera: Camera,
        cam_from_world: Pose,
        rng: np.random.Generator,
        *,
        body: Body | None = None,
    ) -> Run:
        """Start a run in the stream form; it ends with the last reference to it. UserError in the folder form."""
        if self.mode == "folder":
            raise UserError(f"{self.command[0]}: mode `folder` takes a whole sequence; use mode `stream` here")
        with ExitStack() as stack:
            guard = stack.enter_context(job_folder())
            seed = int(rng.integers(2**31))
            write_job(guard.folder, structure, camera, cam_from_world, mode="stream", rate_hz=0.0, seed=seed)
            if body is not None:
                write_sensors(guard.folder, body)
            run = StreamRun(self, stack.enter_context(self.run(guard)))
            run.held = stack.pop_all()
            return run


def isolated_trackers(trackers: Mapping[str, Tracker]) -> dict[str, Tracker]:
    """Trackers by label, with the external programs isolated.

    UserError where isolation is not supported, and for user plug-ins in Python, which run in this process.
    """
    usable()
    for label, tracker in trackers.items():
        if not is_ours(tracker):
            raise UserError(f"isolate: trackers.{label} is Python code in uavbench's own process; make it a program")
    return {label: replace(t, isolate=True) if isinstance(t, External) else t for label, t in trackers.items()}


class StreamRun:
    """A run in the stream form; owes: whether the answer to the last frame is outstanding."""

    held: ExitStack | None = None
    owes = False
    expected = ""

    def __init__(self, tracker: External, process: Process) -> None:
        self.tracker, self.process, self.frames, self.stamp_ns = tracker, process, 0, -1
        self.before = b""
        word = process.line(time.monotonic() + tracker.start_timeout_s, "at its start").strip()
        if word != "ready":
            raise TrackerFault("not-ready", "at its start", f"the first line was {word[:60]!r}")

    def sense(self, samples: Mapping[str, Samples]) -> None:
        """Queue sensor samples to be sent before the next frame."""
        self.before += sample_lines(samples)

    def predict(self, cam_from_world: Pose, covariance: Array) -> None:
        """Queue the predicted pose to be sent before the next frame."""
        numbers = [*cam_from_world.translation, *cam_from_world.quaternion_wxyz, *np.asarray(covariance)[UPPER]]
        self.expected = ",".join(repr(float(number)) for number in numbers)

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """Send the queued samples and prediction and a frame, and read the answer; TrackerFault without a valid one.

        `total` is the wall-clock time from the first byte sent to the answer.
        """
        where = f"frame {self.frames} (stamp {stamp_ns})"
        self.frames += 1
        self.expect_silence(where)
        if self.tracker.pixels == "grey" and image.ndim == 3:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        pixels = np.ascontiguousarray(image)
        height, width, channels = (*pixels.shape, 1)[:3]
        expected = f"{EXPECTED},{stamp_ns},{self.expected}\n" if self.expected else ""
        header = self.before + f"{expected}frame,{stamp_ns},{width},{height},{channels}\n".encode()
        self.before, self.expected = b"", ""
        deadline = time.monotonic() + self.tracker.timeout_s
        begin = time.perf_counter()
        self.owes = True
        self.process.send([header, memoryview(pixels.reshape(-1))], deadline, where)
        answer = self.process.line(deadline, where)
        total_ms = (time.perf_counter() - begin) * 1e3
        try:
            stamp, result = read_row(answer, where)
        except TrackerFault as error:
            if error.fault.name in ROW_FAULTS:  # it is an answer all the same, and none is outstanding
                self.owes, self.stamp_ns = False, stamp_ns
            raise
        if stamp != stamp_ns:
            name = "duplicate" if stamp == self.stamp_ns else "unknown-stamp"
            raise TrackerFault(name, where, f"the answer has the stamp {stamp}")
        self.owes, self.stamp_ns = False, stamp_ns
        return TrackResult(
            status=result.status,
            cam_from_world=result.cam_from_world,
            covariance=result.covariance,
            stage_ms={"total": total_ms},
        )

    def close(self) -> None:
        """Close the program's standard input and wait for its exit; TrackerFault when it hangs or prints more lines."""
        self.process.finish(self.tracker.timeout_s, "at its end")
        self.expect_silence("at its end")

    def expect_silence(self, where: str) -> None:
        """Raise TrackerFault when the program has printed more than one line per frame."""
        more = self.process.said_more()
        if more:
            name = "duplicate" if more.split(",")[0] == str(self.stamp_ns) else "unasked"
            raise TrackerFault(name, where, f"{more[:60]!r} was printed; expected one line for each frame")

    def __del__(self) -> None:
        if self.held is not None:
            self.held.close()


def track_external(
    tracker: External,
    sequence: Sequence,
    *,
    rate_hz: float,
    seed: int,
    kept_folder: Path,
    on_frame: OnFrame | None = None,
    start: Initialization = KNOWN,
) -> Results:
    """Results of a program on every k-th frame of a sequence, from the initial pose of `start`.

    Violations of the protocol make frames lost and are listed under `errors` of the record; the job folder is then kept
    at `kept_folder`. TrackerFault when the program cannot be started, UserError when isolation is requested but not
    supported.
    """
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz)).tolist()
    if tracker.isolate:
        refuse_seen(tracker.command[0], tracker.seen_files, sequence.folder)
    with job_folder() as guard:
        first, folder, feed = initial_pose(start, sequence, 0, seed), guard.folder, Feed(sequence)
        own = int(tracker_stream(tracker, seed).integers(2**31))
        write_job(folder, sequence.structure, sequence.camera, first, mode=tracker.mode, rate_hz=rate_hz, seed=own)
        write_sensors(folder, feed.body)
        if tracker.mode == "stream":
            rows, faults = _by_stream(tracker, sequence, frames, guard, feed, on_frame)
        else:
            rows, faults = _by_folder(tracker, sequence, frames, guard, on_frame)
        if faults:
            keep(folder, kept_folder, faults)
    if faults and faults[0].name == "cannot-start":
        raise TrackerFault(faults[0].name, faults[0].where, faults[0].what)
    messages = [str(fault) for fault in faults[:MAX_FAULTS_REPORTED]]
    if len(faults) > MAX_FAULTS_REPORTED:
        messages.append(f"and {len(faults) - MAX_FAULTS_REPORTED} more faults")
    record = make_record(tracker, sequence, rate_hz=rate_hz, seed=seed, errors=messages, start=start)
    record["tracker"]["kind"] = "external"
    return Results(record, np.array(frames), sequence.stamps_ns[frames], tuple(rows))


def _by_folder(
    tracker: External, sequence: Sequence, frames: list[int], guard: Guard, on_frame: OnFrame | None
) -> Estimates:
    """Track all frames in the folder form; the latency of single frames is unknown."""
    write_frames(guard.folder, sequence, frames)
    faults: list[Fault] = []
    with _named(faults), tracker.run(guard) as process:
        process.finish(tracker.timeout_s, "the run")
    rows, in_file = read_estimates(guard.folder / "estimates.csv", sequence.stamps_ns[frames].tolist())
    if on_frame is not None:
        for frame, row in zip(frames, rows, strict=True):
            on_frame(frame, row)
    more = [fault for fault in in_file if not faults or fault.name not in ("no-output", "missing")]
    return Estimates(rows, faults + more)


def _by_stream(
    tracker: External, sequence: Sequence, frames: list[int], guard: Guard, feed: Feed, on_frame: OnFrame | None
) -> Estimates:
    """Track frame by frame in the stream form; after a protocol fault the remaining frames are lost."""
    rows: list[TrackResult] = []
    faults: list[Fault] = []
    with _named(faults), tracker.run(guard) as process:
        run = StreamRun(tracker, process)
        for frame in frames:
            stamp = int(sequence.stamps_ns[frame])
            image = sequence.image(frame)
            run.sense(feed.upto(stamp))
            try:
                rows.append(run.track(image, stamp))
            except TrackerFault as error:
                if error.fault.name not in ROW_FAULTS:
                    raise
                faults.append(error.fault)
                rows.append(TrackResult(status="lost"))
            if on_frame is not None:
                on_frame(frame, rows[-1])
        run.close()
    rows += [TrackResult(status="lost")] * (len(frames) - len(rows))
    return Estimates(rows, faults)


@contextmanager
def _named(faults: list[Fault]) -> Iterator[None]:
    """Append a TrackerFault raised in the context to the faults."""
    try:
        yield
    except TrackerFault as error:
        faults.append(error.fault)
