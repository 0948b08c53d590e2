"""Ahead-of-use compilation of kernels in two processes, with a progress report.

Each kernel is compiled once per machine and cached (`cache`); later processes load it.
"""

import contextlib
import ctypes
import fcntl
import gc
import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.registry import CPUDispatcher
from tqdm import tqdm

from uavbench.trajectories.kernels.cache import found_once, homes, sources_of
from uavbench.trajectories.kernels.compiled import KERNELS, Kernel

NUMBER = np.dtype(np.uint16)
"""Binary format of a number in the queue."""
LOCK = ".compiling"
"""Lock file next to the kernels that serializes the processes of one user."""
PR_SET_PDEATHSIG = 1
"""Option of prctl (linux/prctl.h)."""


@cache
def prepare(*modules: str) -> None:
    """Compile, or load, every kernel that these modules and all that they import can call.

    Another process helps where there is a second core. A process that finds another one compiling waits for it. What
    was imported is then old to the garbage collector, which would scan all of it, some 0.1 s, in the first frame.
    """
    with found_once():
        missing = [kernel for kernel in kernels_of(modules) if not kernel.load()]
    if missing:
        _compile(missing)
    if gc.isenabled():
        gc.collect()


def _compile(missing: list[Kernel]) -> None:
    """Compile kernels that are not in the cache, unless another process does."""
    with _alone():
        missing = in_order([kernel for kernel in missing if not kernel.load()])
        if missing:
            with _told(missing) as tell, queue_of(len(missing)) as queue, _help(missing, queue), _no_collection():
                for k in taken(queue):
                    missing[k].compile(None)
                    tell()
            for kernel in missing:
                kernel.compile(None)  # loaded if the helper has cached it


def kernels_of(modules: Iterable[str]) -> list[Kernel]:
    """Kernels in the sources of modules and of all that they import, callees first."""
    files = {path.resolve() for path in sources_of(modules)}
    return [kernel for kernel in KERNELS if Path(kernel.py_func.__code__.co_filename).resolve() in files]


def in_order(kernels: list[Kernel]) -> list[Kernel]:
    """Kernels by call depth, leaves first, and by size within a depth, the largest first.

    In this order two processes seldom wait for each other, and end at about the same time.
    """
    return sorted(kernels, key=lambda kernel: (_depth(kernel), -len(kernel.py_func.__code__.co_code)))


@cache
def _depth(kernel: Any) -> int:
    """Depth of a kernel's call graph."""
    function = kernel.py_func
    named = (function.__globals__.get(name) for name in function.__code__.co_names)
    return 1 + max((_depth(value) for value in named if isinstance(value, CPUDispatcher)), default=0)


@contextlib.contextmanager
def _told(kernels: list[Kernel]) -> Iterator[Callable[[], None]]:
    """Report progress when called: a bar on a terminal, otherwise one line."""
    about = "compiling kernels, once after an installation"
    if not sys.stderr.isatty():
        print(f"{about}: {len(kernels)} of them, some 10 to 30 s", file=sys.stderr, flush=True)
        yield lambda: None
        return
    with tqdm(total=len(kernels), desc=about, unit="kernel", leave=False) as bar:

        def tell() -> None:
            bar.update(sum(kernel.load() for kernel in kernels) - bar.n)

        yield tell


@contextlib.contextmanager
def queue_of(count: int) -> Iterator[int]:
    """Pipe with the numbers below count, shared by any number of processes; each number is read once."""
    out, into = os.pipe()
    try:
        os.write(into, np.arange(count, dtype=NUMBER).tobytes())
        os.close(into)
        yield out
    finally:
        os.close(out)


def taken(queue: int) -> Iterator[int]:
    """Numbers that no other process has taken from a queue."""
    while number := os.read(queue, NUMBER.itemsize):
        yield int(np.frombuffer(number, dtype=NUMBER)[0])


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Hold the compilation lock of this user, where the file system has locks."""
    with contextlib.ExitStack() as stack:
        handle = next(_locks(), None)
        if handle is not None:
            stack.callback(os.close, handle)
            with contextlib.suppress(OSError):  # a file system without locks
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    print("another process is compiling kernels; waiting for it", file=sys.stderr, flush=True)
                    fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def _locks() -> Iterator[int]:
    """Handles of the lock file in each candidate folder, best first."""
    for home in homes():
        with contextlib.suppress(OSError):
            home.mkdir(parents=True, exist_ok=True)
            yield os.open(home / LOCK, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)


@contextlib.contextmanager
def _help(kernels: list[Kernel], queue: int) -> Iterator[None]:
    """Context in which another process also takes kernels from the queue; waits for its last one."""
    if len(os.sched_getaffinity(0)) < 2:
        yield
        return
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    names = [f"{kernel.py_func.__module__}:{kernel.py_func.__qualname__}" for kernel in kernels]
    command = [sys.executable, "-m", "uavbench.trajectories.kernels.warm_up", str(os.getpid()), *names]
    quiet = subprocess.DEVNULL
    try:
        helper = subprocess.Popen(command, env=environment, stdin=queue, stdout=quiet, stderr=quiet)
    except OSError:  # without permission to start processes, compile alone
        yield
        return
    try:
        yield
        helper.wait()
    finally:
        helper.kill()
        helper.wait()


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Disable garbage collection, an eighth of numba's compilation time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def main(parent: int, names: list[str]) -> None:
    """Compile those of the kernels, each named `module:function`, that are taken from the queue on standard input.

    Exits when its parent process ends for any reason.
    """
    _end_with(parent)
    modules = list(dict.fromkeys(name.partition(":")[0] for name in names))
    gc.disable()
    for module in modules:
        importlib.import_module(module)
    known = {f"{kernel.py_func.__module__}:{kernel.py_func.__qualname__}": kernel for kernel in KERNELS}
    for k in taken(sys.stdin.fileno()):
        known[names[k]].compile(None)


def _end_with(parent: int) -> None:
    """Make the operating system kill this process when its parent ends; exit if the parent has already ended."""
    with contextlib.suppress(OSError, AttributeError):  # prctl exists on Linux only
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
