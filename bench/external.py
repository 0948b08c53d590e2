"""External trackers: a program in any language, given a folder or a stream of frames, never the truth.

In the folder form the program gets all frames at once and writes `estimates.csv`. In the stream form it gets one frame
at a time on standard input, says `ready` once and then one line for each frame, so that its latency is measured here
and it cannot look ahead. docs/external-trackers.md is the protocol in full.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Ge, Gt, MinLen

from bench.command_files import command_files
from bench.external_job import imu_lines, job_folder, keep, write_frames, write_job
from bench.external_process import Process
from bench.external_rows import Fault, TrackerFault, read_estimates, read_row
from scenes.camera import Camera
from scenes.sequence import Sequence
from scenes.structure import Structure
from tracker.base import Image, Run, TrackResult
from tracker.initial_pose import Initialization
from tracker.results import Results
from tracker.run import KNOWN, first_pose, make_record, stride
from trajectories.errors import UserError
from trajectories.pose import Pose

OnFrame = Callable[[int, TrackResult], None]
MAX_FAULTS_TOLD = 20
ROW_FAULTS = ("not-finite", "bad-rotation", "bad-covariance")
"""Faults that cost one frame and leave program and harness in step."""


@dataclass(frozen=True, kw_only=True)
class External:
    """A program of your own, in any language, as a tracker.

    command: program and arguments, no shell; those that are files beside the config are found there. mode: `stream`
    gives a frame at a time, `folder` all at once. pixels: what the stream carries. timeout_s: for one frame, or for the
    whole folder; start_timeout_s: until `ready`. memory_mb: address space that each of its processes may have.
    input_files: further files whose change makes its results stale (sources, weights).
    """

    command: Annotated[tuple[str, ...], MinLen(1)]
    mode: Literal["stream", "folder"] = "stream"
    pixels: Literal["bgr", "grey"] = "bgr"
    timeout_s: Annotated[float, Gt(0)] = 60.0
    start_timeout_s: Annotated[float, Gt(0)] = 60.0
    memory_mb: Annotated[int, Ge(16)] = 8192
    input_files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.input_files:
            if not Path(name).is_file():
                raise ValueError(f"input_files: {name} is no file")

    @property
    def entering_files(self) -> tuple[Path, ...]:
        """Files whose content enters every result: what the command is made of, the input_files, the protocol's own."""
        own = sorted(Path(__file__).parent.glob("external*.py"))
        return (*own, *command_files(self.command), *map(Path, self.input_files))

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Begin a run in the stream form; it ends with the last reference to it. UserError in the folder form."""
        if self.mode == "folder":
            raise UserError(f"{self.command[0]}: mode `folder` takes a whole sequence; use mode `stream` here")
        with ExitStack() as stack:
            folder = stack.enter_context(job_folder())
            seed = int(rng.integers(2**31))
            write_job(folder, structure, camera, cam_from_world, mode="stream", rate_hz=0.0, seed=seed)
            process = stack.enter_context(Process(self.command, folder, memory_mb=self.memory_mb, piped=True))
            run = StreamRun(self, process)
            run.held = stack.pop_all()
            return run


class StreamRun:
    """A run of a program that gets a frame at a time."""

    held: ExitStack | None = None

    def __init__(self, tracker: External, process: Process) -> None:
        self.tracker, self.process, self.frames, self.stamp_ns = tracker, process, 0, -1
        word = process.line(time.monotonic() + tracker.start_timeout_s, "at its start").strip()
        if word != "ready":
            raise TrackerFault("not-ready", "at its start", f"the first line was {word[:60]!r}")

    def track(self, image: Image, stamp_ns: int, before: bytes = b"") -> TrackResult:
        """Send the lines `before` and a frame, take its answer; TrackerFault when there is no good one.

        `total` is the wall time from the first byte of the frame sent until the answer was there.
        """
        where = f"frame {self.frames} (stamp {stamp_ns})"
        self.expect_silence(where)
        if self.tracker.pixels == "grey" and image.ndim == 3:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        pixels = np.ascontiguousarray(image)
        height, width, channels = (*pixels.shape, 1)[:3]
        header = before + f"frame,{stamp_ns},{width},{height},{channels}\n".encode()
        deadline = time.monotonic() + self.tracker.timeout_s
        begin = time.perf_counter()
        self.process.send([header, memoryview(pixels.reshape(-1))], deadline, where)
        answer = self.process.line(deadline, where)
        total_ms = (time.perf_counter() - begin) * 1e3
        self.frames += 1
        stamp, result = read_row(answer, where)
        if stamp != stamp_ns:
            name = "duplicate" if stamp == self.stamp_ns else "unknown-stamp"
            raise TrackerFault(name, where, f"the answer has the stamp {stamp}")
        self.stamp_ns = stamp_ns
        return TrackResult(
            status=result.status,
            cam_from_world=result.cam_from_world,
            covariance=result.covariance,
            stage_ms={"total": total_ms},
        )

    def close(self) -> None:
        """End the program's standard input and let it end by itself; TrackerFault when it does not, or says more."""
        self.process.finish(self.tracker.timeout_s, "at its end")
        self.expect_silence("at its end")

    def expect_silence(self, where: str) -> None:
        """TrackerFault when more than one line for each frame was said."""
        more = self.process.said_more()
        if more:
            name = "duplicate" if more.split(",")[0] == str(self.stamp_ns) else "unasked"
            raise TrackerFault(name, where, f"{more[:60]!r} was said beyond one line for each frame")

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
    """Results of a program on every k-th frame of a sequence, from the first pose of `start`.

    What breaks the protocol makes frames lost and is told under `errors` in the record; the job folder is then kept at
    `kept_folder`. TrackerFault when the program cannot be started at all.
    """
    frames = np.arange(0, len(sequence), stride(sequence, rate_hz)).tolist()
    with job_folder() as folder:
        first = first_pose(start, sequence, 0, seed)
        write_job(folder, sequence.structure, sequence.camera, first, mode=tracker.mode, rate_hz=rate_hz, seed=seed)
        way = _by_stream if tracker.mode == "stream" else _by_folder
        rows, faults = way(tracker, sequence, frames, folder, on_frame)
        if faults:
            keep(folder, kept_folder, faults)
    if faults and faults[0].name == "cannot-start":
        raise TrackerFault(faults[0].name, faults[0].where, faults[0].what)
    told = [str(fault) for fault in faults[:MAX_FAULTS_TOLD]]
    if len(faults) > MAX_FAULTS_TOLD:
        told.append(f"and {len(faults) - MAX_FAULTS_TOLD} more faults")
    record = make_record(tracker, sequence, rate_hz=rate_hz, seed=seed, errors=told, start=start)
    record["tracker"]["kind"] = "external"
    return Results(record, np.array(frames), sequence.stamps_ns[frames], tuple(rows))


def _by_folder(
    tracker: External, sequence: Sequence, frames: list[int], folder: Path, on_frame: OnFrame | None
) -> tuple[list[TrackResult], list[Fault]]:
    """All frames at once; no latency of a frame can be known."""
    write_frames(folder, sequence, frames)
    faults: list[Fault] = []
    with _named(faults), Process(tracker.command, folder, memory_mb=tracker.memory_mb, piped=False) as process:
        process.finish(tracker.timeout_s, "the run")
    rows, in_file = read_estimates(folder / "estimates.csv", sequence.stamps_ns[frames].tolist())
    if on_frame is not None:
        for frame, row in zip(frames, rows, strict=True):
            on_frame(frame, row)
    return rows, faults + [fault for fault in in_file if not faults or fault.name not in ("no-output", "missing")]


def _by_stream(
    tracker: External, sequence: Sequence, frames: list[int], folder: Path, on_frame: OnFrame | None
) -> tuple[list[TrackResult], list[Fault]]:
    """A frame at a time; after a fault of the protocol the rest is lost."""
    rows: list[TrackResult] = []
    faults: list[Fault] = []
    samples = imu_lines(sequence)
    with _named(faults), Process(tracker.command, folder, memory_mb=tracker.memory_mb, piped=True) as process:
        run = StreamRun(tracker, process)
        sent = 0
        for frame in frames:
            stamp = int(sequence.stamps_ns[frame])
            upto = sent
            while upto < len(samples) and samples[upto][0] <= stamp:
                upto += 1
            imu, sent = b"".join(line for _, line in samples[sent:upto]), upto
            try:
                rows.append(run.track(sequence.image(frame), stamp, imu))
            except TrackerFault as error:
                if error.fault.name not in ROW_FAULTS:
                    raise
                faults.append(error.fault)
                rows.append(TrackResult(status="lost"))
            if on_frame is not None:
                on_frame(frame, rows[-1])
        run.close()
    rows += [TrackResult(status="lost")] * (len(frames) - len(rows))
    return rows, faults


@contextmanager
def _named(faults: list[Fault]) -> Iterator[None]:
    """Gather the fault that ends a run."""
    try:
        yield
    except TrackerFault as error:
        faults.append(error.fault)
