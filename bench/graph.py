"""Run a graph of jobs on an executor: what is fresh is left alone, what fails does not stop the rest."""

import multiprocessing
import queue
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from tqdm import tqdm

from bench.content import carried_hash
from trajectories.errors import UserError

OnStep = Callable[[int, int], None]


class Work(Protocol):
    """What a job does: a picklable value whose call writes the job's output."""

    def __call__(self, content_hash: str, on_step: OnStep) -> None:
        """Write the output, its marker carrying content_hash; on_step(done, total) tells progress."""
        ...


@dataclass(frozen=True, kw_only=True)
class Job:
    """One idempotent step of a suite.

    verb and name are what is shown; marker is the JSON file that carries the content hash once the output is whole.
    """

    verb: str
    name: str
    work: Work
    marker: Path
    content_hash: str
    needs: tuple["Job", ...] = ()
    weight: float = 1.0

    @property
    def fresh(self) -> bool:
        """Whether the output is there, made from just what would make it now."""
        return carried_hash(self.marker) == self.content_hash


@dataclass
class Outcome:
    """What became of a graph: jobs done, jobs that were fresh, why others failed, and what it took.

    tracebacks are of the failures that are not a user's mistake.
    """

    done: list[Job] = field(default_factory=list)
    fresh: list[Job] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    tracebacks: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    wall_s: float = 0.0
    peak_mb: float = 0.0


_progress: Any = None


def start_worker(progress: Any) -> None:
    """Set up a worker: an interrupt is the parent's to handle, a termination cleans up what is half-written."""
    global _progress
    _progress = progress
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))


def run_job(name: str, work: Work, content_hash: str) -> tuple[float, float]:
    """Do one job in a worker; seconds it took and the worker's peak memory in MB."""
    begin = time.perf_counter()

    def on_step(done: int, total: int) -> None:
        if _progress is not None:
            _progress.put((name, done / max(total, 1)))

    work(content_hash, on_step)
    return time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@contextmanager
def local_pool(workers: int) -> Iterator[tuple[Executor, Any]]:
    """Pool of spawned processes (a GL context each) and the queue on which they tell their progress."""
    context = multiprocessing.get_context("spawn")
    progress = context.Queue()
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=start_worker, initargs=(progress,))
    try:
        yield pool, progress
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        for child in multiprocessing.active_children():
            child.join(timeout=10)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_graph(jobs: list[Job], executor: Executor, progress: Any = None) -> Outcome:
    """Run every job that is not fresh, after the jobs it needs; a job whose need failed is failed too."""
    begin = time.perf_counter()
    outcome = Outcome(fresh=[job for job in jobs if job.fresh])
    settled = {id(job) for job in outcome.fresh}
    todo = [job for job in jobs if id(job) not in settled]
    running: dict[Future[tuple[float, float]], Job] = {}
    peaks: dict[str, float] = {}
    with Bar(todo) as bar:
        while todo or running:
            for job in list(todo):
                broken = next((n.name for n in job.needs if n.name in outcome.failed), None)
                if broken is not None:
                    outcome.failed[job.name] = f"not done, because this failed: {broken}"
                    todo.remove(job)
                elif all(id(need) in settled for need in job.needs):
                    running[executor.submit(run_job, job.name, job.work, job.content_hash)] = job
                    todo.remove(job)
            finished, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
            bar.drain(progress)
            for future in finished:
                job = running.pop(future)
                settled.add(id(job))
                _settle(job, future, outcome, peaks)
                bar.finish(job, outcome)
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    workers = sorted(peaks.values(), reverse=True)[: getattr(executor, "_max_workers", 1)]
    outcome.wall_s, outcome.peak_mb = time.perf_counter() - begin, own + sum(workers)
    return outcome


def _settle(job: Job, future: Future[tuple[float, float]], outcome: Outcome, peaks: dict[str, float]) -> None:
    try:
        seconds, peaks[job.name] = future.result()
    except UserError as error:
        outcome.failed[job.name] = str(error)
    except BrokenProcessPool:
        outcome.failed[job.name] = "its worker process died (out of memory?); run the same command again to resume"
    except Exception as error:
        outcome.failed[job.name] = f"{type(error).__name__}: {error}"
        outcome.tracebacks[job.name] = "".join(traceback.format_exception(error))
    else:
        outcome.done.append(job)
        outcome.seconds[job.name] = seconds


class Bar:
    """Progress over a graph in shares of its jobs: a bar on a terminal, a line per job elsewhere."""

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
        """Take in what the workers have told."""
        while progress is not None:
            try:
                name, share = progress.get_nowait()
            except queue.Empty:
                break
            if name in self.share and share > self.share[name]:
                self._move(name, share)
                self.bar.set_description_str(name)

    def finish(self, job: Job, outcome: Outcome) -> None:
        """Mark a job as settled."""
        self._move(job.name, 1.0)
        if job.name in outcome.seconds:
            self.bar.write(f"  {job.name:<44} {outcome.seconds[job.name]:7.1f} s", file=sys.stderr)

    def _move(self, name: str, share: float) -> None:
        self.bar.update((share - self.share[name]) * self.weight[name])
        self.share[name] = share
