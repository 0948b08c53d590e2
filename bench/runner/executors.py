"""Executors of jobs: local spawned processes, or a Dask cluster."""

import logging
import multiprocessing
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from uavbench.bench.inputs.content_hash import code_hash
from uavbench.bench.inputs.plugin_kernels import written_since_start
from uavbench.bench.runner.graph import start_worker
from uavbench.bench.runner.processes import hold_interrupts, in_worker, start_resource_tracker, started
from uavbench.trajectories.errors import UserError

WAIT_FOR_WORKERS_S = 60
MOST_DEATHS = 2
"""Deaths of workers after which a call is retried: one that another call may have caused, and one more by chance."""
OF_JOBS = "uavbench.bench.runner.tasks"
"""Module that imports what jobs need."""
PACKAGES = ("bench", "reports", "scenes", "tracker", "trajectories")


@dataclass
class Task:
    """A submitted call; deaths: number of times that a worker died while the call ran or waited for a worker."""

    call: Callable[[], Any]
    future: Future[Any] = field(default_factory=Future)
    deaths: int = 0


@dataclass(frozen=True)
class Call:
    """A function with its arguments, picklable."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self) -> Any:
        """Call the function in a worker."""
        return in_worker(self.function, self.arguments)


class SpawnPool(Executor):
    """Pool of spawned processes with a GL context each; when a worker dies, only the call that it ran fails.

    `ProcessPoolExecutor` fails all calls when one worker dies. Here the calls that were running are retried one at a
    time; a call whose workers keep dying fails, and the others continue. All workers are started by one thread that
    lives as long as the pool, because the kernel kills a worker with the thread that started it (PDEATHSIG). The same
    thread ends them: two that shut down one `ProcessPoolExecutor` may close its pipes twice, the second time those of
    another, which has got their numbers.
    """

    def __init__(self, workers: int) -> None:
        self._max_workers = workers
        self._context = multiprocessing.get_context("spawn")
        start_resource_tracker()
        self.progress = self._context.Queue()
        self._lock = threading.RLock()
        self._waiting: deque[Task] = deque()
        self._suspects: deque[Task] = deque()
        self._running: dict[Future[Any], Task] = {}
        self._starter = ThreadPoolExecutor(1, "pool-starter", initializer=hold_interrupts)
        self._pool = self._new_pool()
        self._broken = self._closed = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Future of a call; it raises BrokenProcessPool when its worker died three times."""
        assert not kwargs, "positional arguments only"
        task = Task(Call(fn, args))
        with self._lock:
            self._waiting.append(task)
            self._fill_soon()
        return task.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the workers; pending calls are cancelled."""
        with self._lock:
            self._closed = True
            for task in (*self._waiting, *self._suspects):
                task.future.cancel()
            self._waiting.clear()
            self._suspects.clear()
        self._starter.submit(lambda: self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)).result()
        if wait:
            self._starter.shutdown()  # last, since workers still running are killed with this thread

    def _new_pool(self) -> ProcessPoolExecutor:
        start = (OF_JOBS, start_worker.__module__, start_worker.__name__, self.progress)
        return ProcessPoolExecutor(self._max_workers, mp_context=self._context, initializer=started, initargs=start)

    def _fill_soon(self) -> None:
        if not self._closed:
            self._starter.submit(self._fill)

    def _fill(self) -> None:
        """Start the calls that may run now: suspects one at a time, others on all workers."""
        with self._lock:
            broken = self._pool if self._broken and not (self._running or self._closed) else None
        if broken is not None:
            broken.shutdown(wait=True)  # else a call could be retried while its first worker still cleans up
            with self._lock:
                self._pool, self._broken = self._new_pool(), False
        self._start_some()

    def _start_some(self) -> None:
        # Never with the lock held: a broken pool holds its own while it settles its calls, which takes this one.
        while (task := self._next()) is not None:
            try:
                future = self._pool.submit(task.call)
                _watch_new_worker(self._pool)
            except BrokenProcessPool:
                with self._lock:
                    (self._suspects if task.deaths else self._waiting).appendleft(task)
                    self._broken = True
                    self._fill_soon()
                return
            except Exception as error:  # no process could be started
                task.future.set_exception(error)
                continue
            with self._lock:
                self._running[future] = task
            future.add_done_callback(self._settle)

    def _next(self) -> Task | None:
        """The call that may start now, if any."""
        with self._lock:
            source, limit = (self._suspects, 1) if self._suspects else (self._waiting, self._max_workers)
            may = len(self._running) < limit and not (self._broken or self._closed)
            return source.popleft() if source and may else None

    def _settle(self, future: Future[Any]) -> None:
        with self._lock:
            task = self._running.pop(future)
            error = None if future.cancelled() else future.exception()
            died = isinstance(error, BrokenProcessPool) and not self._closed
            task.deaths += died
            again = died and task.deaths <= MOST_DEATHS
            if again:
                self._suspects.append(task)
            self._broken |= died
            self._fill_soon()
        if again:
            return
        if future.cancelled():
            task.future.cancel()
        elif error is not None:
            task.future.set_exception(error)
        else:
            task.future.set_result(future.result())


def _watch_new_worker(pool: Any) -> None:
    """Make a pool watch the worker that its latest call may have started.

    Its thread waits for the workers that it knew when it was last woken, which is before a worker is started: the death
    of that worker would be noticed only when another one ends its call.
    """
    with pool._shutdown_lock:
        pool._executor_manager_thread_wakeup.wakeup()


class Pool(NamedTuple):
    """An executor, and the queue on which its workers report progress, None if they do not."""

    executor: Executor
    progress: Any


@contextmanager
def local_pool(workers: int) -> Iterator[Pool]:
    """Context with a pool of spawned processes and their progress queue; no process outlives it."""
    pool = SpawnPool(workers)
    try:
        yield Pool(pool, pool.progress)
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        for child in multiprocessing.active_children():
            child.join(timeout=10)
            child.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def dask_pool(address: str, workers: int, folder: Path) -> Iterator[Pool]:
    """Executor of a Dask cluster at `tcp://HOST:PORT`, or of a `local` one of this many workers.

    UserError when Dask is not installed, the scheduler does not answer, or a worker has several threads, does not see
    the folder, or has another uavbench.
    """
    try:
        from distributed import Client, LocalCluster  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise UserError("--dask needs Dask: pip install 'uavbench[dask]'") from None
    try:
        if address == "local":
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
            )  # its workers would log the traceback of each job that fails, which `tell` reports
            client = Client(cluster)
        else:
            cluster, client = None, Client(address)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(f"--dask {address}: {error}; is `dask scheduler` running there?") from None
    try:
        _check_workers(client, folder)
        yield Pool(client.get_executor(pure=False, retries=2), None)
    finally:
        client.close()
        if cluster is not None:
            cluster.close()


def _check_workers(client: Any, folder: Path) -> None:
    try:
        client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
    except TimeoutError:
        why = "the cluster has no workers; start some: dask worker tcp://HOST:PORT --nthreads 1"
        raise UserError(f"--dask: {why}") from None
    workers = client.scheduler_info(n_workers=-1)["workers"]
    for address, about in workers.items():
        if about["nthreads"] != 1:
            raise UserError(f"--dask: worker {address} has {about['nthreads']} threads; start it with --nthreads 1")
    for address, (sees, code, written) in client.run(_what_a_worker_has, str(folder)).items():
        if written:
            raise UserError(f"--dask: worker {address} may run an older {written[0]} than the one there; restart it")
        if not sees:
            raise UserError(f"--dask: worker {address} does not see {folder}; name a folder on a shared file system")
        if code != code_hash(*PACKAGES):
            raise UserError(f"--dask: worker {address} has another uavbench, or other libraries; install the same one")


class Has(NamedTuple):
    """Whether a worker sees the folder, the hash of its code, and files of users that it may run in an older state."""

    sees: bool
    code: str
    written: list[str]


def _what_a_worker_has(folder: str) -> Has:
    return Has((Path(folder) / "suite.json").is_file(), code_hash(*PACKAGES), written_since_start())
