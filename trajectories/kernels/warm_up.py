"""Compiles kernels before they are needed: by two processes, and with a word about it, since it takes seconds.

Each kernel is compiled once on a machine, and kept (`kernel_cache`); then a process only loads what it needs.
"""

import contextlib
import fcntl
import gc
import importlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from tqdm import tqdm

from uavbench.trajectories.kernels.compiled import KERNELS, Kernel
from uavbench.trajectories.source_files import sources


@cache
def prepare(*modules: str) -> None:
    """Compile, or load, every kernel that these modules and all that they import can call.

    Another process helps where there is a second core. A process that finds another one compiling waits for it.
    """
    missing = [kernel for kernel in kernels_of(modules) if not kernel.load()]
    if not missing:
        return
    with _alone():
        missing = [kernel for kernel in missing if not kernel.load()]
        if missing:
            with _help(modules), _no_collection():
                for kernel in _with_progress(missing):
                    kernel.compile(None)


def kernels_of(modules: Iterable[str]) -> list[Kernel]:
    """Kernels in the sources of modules and of all that they import, callees first."""
    files = {path.resolve() for module in modules for path in sources(module)}
    return [kernel for kernel in KERNELS if Path(kernel.py_func.__code__.co_filename).resolve() in files]


def _with_progress(kernels: list[Kernel]) -> Iterable[Kernel]:
    """The kernels, with a bar on a terminal, and else one line."""
    about = "compiling kernels, once after an installation"
    if sys.stderr.isatty():
        return tqdm(kernels, desc=about, unit="kernel", leave=False)
    print(f"{about}: {len(kernels)} of them, some 10 to 60 s", file=sys.stderr, flush=True)
    return kernels


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Hold the lock of those who compile for this user, where a lock can be had."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path = Path(tempfile.gettempdir()) / f"uavbench-kernels-{os.getuid()}.lock"
            handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _help(modules: Iterable[str]) -> Iterator[None]:
    """Have another process compile from the other end; what it has kept need not be compiled here."""
    if len(os.sched_getaffinity(0)) < 2:
        yield
        return
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", "uavbench.trajectories.kernels.warm_up", *modules]
    quiet = subprocess.DEVNULL
    try:
        helper = subprocess.Popen(command, env=environment, stdin=quiet, stdout=quiet, stderr=quiet)
    except OSError:  # one that may start no process compiles alone
        yield
        return
    try:
        yield
    finally:
        helper.kill()
        helper.wait()


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Without garbage collection, which takes an eighth of the time while numba builds its trees."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def main(modules: list[str]) -> None:
    """Compile the kernels of modules, those first that others compile last."""
    for module in modules:
        importlib.import_module(module)
    with _no_collection():
        for kernel in reversed(kernels_of(modules)):
            kernel.compile(None)


if __name__ == "__main__":
    main(sys.argv[1:])
