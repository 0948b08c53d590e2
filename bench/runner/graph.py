"""Runs a graph of jobs on an executor: up-to-date jobs are skipped, failures do not stop independent jobs."""

import queue
import resource
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
from tqdm import tqdm

from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.inputs.observed.seen_inputs import seen_inputs
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.processes import end_children_at_exit, end_when_told, end_with_parent
from uavbench.bench.runner.written_files import Made, Place, expect_whole
from uavbench.tracker.faults import named, users_place
from uavbench.trajectories.errors import DISK_ERRORS, DiskError, Terminated, UserError, one_line, plain
from uavbench.trajectories.files.listed import Marker

OnStep = Callable[[int, int], None]


NOT_DONE = "not done, because this failed: "
"""Prefix of the reason of a job that was not run."""
WORKER_DIED = (
    "its worker process died: out of memory, or ended or crashed by a plug-in (try a tracker with `uavbench check`); "
    "run the same command again to resume"
)


class Work(Protocol):
    """Task of a job: a picklable callable that writes the job's output."""

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the output, with content_hash in its marker; on_step(done, total) reports progress."""
        ...


@dataclass(frozen=True, kw_only=True)
class Job:
    """One idempotent step of a suite.

    verb, name: shown to the user; marker: JSON file that holds the content hash once the output is complete; root: the
    suite's folder, by default the marker's; lists: the list of the marker's folder, if that belongs to this
    job alone; keyed: files whose content the hash holds; without: maps the reasons of failed jobs by name to a
    substitute task when needs failed; if it is None or returns None, this job fails too.
    """

    verb: str
    name: str
    work: Work
    marker: Path
    content_hash: str
    needs: tuple["Job", ...] = ()
    weight: float = 1.0
    root: Path | None = None
    lists: Marker | None = None
    keyed: frozenset[Path] = frozenset()
    without: Callable[[Mapping[str, str]], Work | None] | None = None

    @property
    def place(self) -> Place:
        """Place of its output."""
        return Place(self.root or self.marker.parent, self.marker, self.lists)

    @property
    def made(self) -> Made:
        """Its output, made from the current inputs."""
        return Made(self.place, self.content_hash)

    @property
    def fresh(self) -> bool:
        """Whether the output is unchanged since it was written, and was made from the current inputs."""
        return self.made.is_fresh


@dataclass
class Outcome:
    """Result of a graph: jobs done, jobs that were up to date, reasons of failures, times and memory.

    mistakes: names of the jobs that failed because of a mistake in the input; tracebacks: of failures that are neither
    that nor a full or broken disk.
    """

    done: list[Job] = field(default_factory=list)
    fresh: list[Job] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    mistakes: set[str] = field(default_factory=set)
    tracebacks: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    wall_s: float = 0.0
    peak_mb: float = 0.0

    @property
    def users_mistake(self) -> bool:
        """Whether a job failed because of a mistake in the input."""
        return bool(self.mistakes)


class JobFaultError(Exception):
    """Failure of a job other than a user error; holds only text, so that it can be pickled whatever was raised."""


_progress: Any = None


def start_worker(progress: Any) -> None:
    """Set up a worker: interrupts are left to the parent, SIGTERM removes incomplete files."""
    global _progress
    _progress = progress
    if progress is not None:
        progress.cancel_join_thread()  # else SIGTERM during put() would wait for the queue's thread forever
    cv2.setNumThreads(1)  # one core per worker
    end_with_parent()
    end_children_at_exit()
    end_when_told()  # last, because an exception here prints a traceback, and nothing has been written yet


def fresh_jobs(jobs: list[Job]) -> list[Job]:
    """Jobs that are up to date together with all their needs: damaged output is remade with everything derived from it.

    jobs: in topological order.
    """
    fresh: dict[int, Job] = {}
    for job in jobs:
        if all(id(need) in fresh for need in job.needs) and job.fresh:
            fresh[id(job)] = job
    return list(fresh.values())


class JobCost(NamedTuple):
    """Wall time of a job in s, and the peak memory of its worker in MB."""

    seconds: float
    peak_mb: float


def run_job(
    plugins: Plugins,
    name: str,
    work: Work,
    made: Made,
    needs: tuple[Made, ...] = (),
    keyed: frozenset[Path] = frozenset(),
) -> JobCost:
    """Run one job in a worker and return its cost.

    A job that is already done is skipped: a cluster may resubmit it when the worker that ran it was lost. plugins: the
    user's, the first argument and imported first, since they may change what the module of a class defines. needs: the
    outputs that it reads; one that another process replaces meanwhile makes it fail. keyed: files that its hash holds;
    what it reads beyond them goes into its record.
    """
    begin = time.perf_counter()
    if made.is_fresh:
        return JobCost(0.0, 0.0)

    def on_step(done: int, total: int) -> None:
        if _progress is not None:
            _progress.put((name, done / max(total, 1)))

    try:
        plugins.enter()
        with made.place.writing(made.content_hash, partial(seen_inputs, keyed)):
            expect_whole(needs)
            work(made.content_hash, on_step)
            expect_whole(needs)
    except DiskError as error:
        raise DiskError(str(error)) from error
    except UserError as error:
        raise UserError(str(error)) from error
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise JobFaultError(fault_line(error)) from error
        raise DiskError.of(error) from error
    except (KeyboardInterrupt, Terminated):
        raise
    except BaseException as error:  # a user's plug-in may raise anything, including SystemExit
        raise JobFaultError(fault_line(error)) from error
    return JobCost(time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def run_graph(jobs: list[Job], executor: Executor, progress: Any = None) -> Outcome:
    """Run every job that is not up to date, after its needs; when one of these failed, it fails or runs without it.

    UserError before the first job when a job's folder holds files that uavbench did not write.
    """
    begin = time.perf_counter()
    for job in jobs:
        job.place.refuse_foreign()
    outcome = Outcome(fresh=fresh_jobs(jobs))
    fresh = {id(job) for job in outcome.fresh}
    todo = [job for job in jobs if id(job) not in fresh]
    for job in todo:
        if job.made.is_whole:  # its worker would take it for done: what it needs is made anew, maybe with the same key
            job.place.disown()
    awaited = {id(job): sum(id(need) not in fresh for need in job.needs) for job in todo}
    dependents: dict[int, list[Job]] = {}
    for job in todo:
        for need in job.needs:
            dependents.setdefault(id(need), []).append(job)
    running: dict[Future[JobCost], Job] = {}
    settled: queue.SimpleQueue[Future[JobCost]] = queue.SimpleQueue()
    peaks: dict[str, float] = {}

    plugins = Plugins.here()

    def start(job: Job) -> None:
        needs = tuple(need.made for need in job.needs if need.name not in outcome.failed)
        future = executor.submit(run_job, plugins, job.name, job.work, job.made, needs, job.keyed)
        running[future] = job
        future.add_done_callback(settled.put)

    def release(job: Job) -> None:
        """Start, or fail, the jobs that waited for a finished job."""
        for dependent in dependents.get(id(job), ()):
            awaited[id(dependent)] -= 1
            if dependent.name in outcome.failed or (awaited[id(dependent)] and dependent.without):
                continue
            lost = [need.name for need in dependent.needs if need.name in outcome.failed]
            instead = dependent.without(outcome.failed) if lost and dependent.without else None
            if lost and instead is None:
                outcome.failed[dependent.name] = f"{NOT_DONE}{lost[0]}"
                release(dependent)
            elif instead is not None:
                made_from = content_hash(dependent.content_hash, sorted(outcome.failed.items()))
                start(replace(dependent, work=instead, content_hash=made_from))
            elif not awaited[id(dependent)]:
                start(dependent)

    with Bar(todo) as bar:
        for job in todo:
            if not awaited[id(job)]:
                start(job)
        while running:
            bar.drain(progress)
            try:
                future = settled.get(timeout=0.2)
            except queue.Empty:
                continue
            job = running.pop(future)
            _settle(job, future, outcome, peaks)
            bar.finish(job, outcome)
            release(job)
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    workers = sorted(peaks.values(), reverse=True)[: getattr(executor, "_max_workers", 1)]
    outcome.wall_s, outcome.peak_mb = time.perf_counter() - begin, own + sum(workers)
    return outcome


def fault_line(error: BaseException) -> str:
    """The exception as text, with its place in the code of a user's plug-in."""
    return f"{one_line(named(error))}{users_place(error)}"


def _settle(job: Job, future: Future[JobCost], outcome: Outcome, peaks: dict[str, float]) -> None:
    try:
        seconds, peaks[job.name] = future.result()
    except UserError as error:
        outcome.failed[job.name] = str(error)
        if not isinstance(error, DiskError):
            outcome.mistakes.add(job.name)
    except BrokenProcessPool:
        outcome.failed[job.name] = WORKER_DIED
    except Exception as error:
        kind = "" if isinstance(error, JobFaultError) else f"{type(error).__name__}: "
        outcome.failed[job.name] = plain(f"{kind}{error}")
        outcome.tracebacks[job.name] = plain("".join(traceback.format_exception(error)))
    else:
        outcome.done.append(job)
        outcome.seconds[job.name] = seconds


class Bar:
    """Progress of a graph: a bar on a terminal, a line per job elsewhere."""

    def __init__(self, jobs: list[Job]) -> None:
        self.weight = {job.name: job.weight for job in jobs}
        self.share = dict.fromkeys(self.weight, 0.0)
        self.bar = tqdm(
            total=round(sum(self.weight.values()), 3) or 1,
            disable=None,
            bar_format="{desc} {percentage:3.0f}% |{bar}| {elapsed} elapsed, {remaining} left",
        )

    def __enter__(self) -> "Bar":
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.close()

    def drain(self, progress: Any) -> None:
        """Process the workers' messages."""
        while progress is not None:
            try:
                name, share = progress.get_nowait()
            except queue.Empty:
                break
            if name in self.share and share > self.share[name]:
                self._move(name, share)
                self.bar.set_description_str(name)

    def finish(self, job: Job, outcome: Outcome) -> None:
        """Mark a job as finished."""
        self._move(job.name, 1.0)
        if job.name in outcome.seconds:
            self.bar.write(f"  {job.name:<44} {outcome.seconds[job.name]:7.1f} s", file=sys.stderr)

    def _move(self, name: str, share: float) -> None:
        self.bar.update((share - self.share[name]) * self.weight[name])
        self.share[name] = share
