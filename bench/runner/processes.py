"""Lifetime of worker processes: they end with the main process, and clean up on termination."""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from multiprocessing import connection, resource_tracker
from multiprocessing.util import Finalize
from typing import Any, NoReturn

from uavbench.trajectories.errors import Terminated
from uavbench.trajectories.lost_signals import raise_lost_signals_again
from uavbench.trajectories.processes.forked import ending_what_forked_off
from uavbench.trajectories.processes.guard_process import die_with, end_descendants, is_guard
from uavbench.trajectories.processes.standard_streams import forgive_lost_output

_is_called = False
_told = 0


def end_with_parent() -> None:
    """Make this worker end when its parent process ends, for whatever reason.

    On Linux the kernel does so (PDEATHSIG); elsewhere, and if the thread that started it outlives the parent, a pipe.
    """
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None:
        return
    die_with(parent.pid)
    threading.Thread(target=_end_after, args=(parent.sentinel,), name="parent-watch", daemon=True).start()


def hold_interrupts() -> None:
    """Block interrupts in this thread and in the processes that it starts while these import their modules."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def started(needed: str, module: str, start: str, *arguments: Any) -> None:
    """Start a worker: import the module `needed`, then call the function `start` of a module.

    Imports make no garbage: collections during them took a tenth of their time, and each full one later went through
    all that they made, together 0.2 s. So there is none during them, and what they made is left out from then on.

    A plug-in that prints does not fail where standard output is full, nor what a library says end in a user's file.
    """
    forgive_lost_output()
    gc.disable()
    import_module(needed)
    function = getattr(import_module(module), start)
    gc.freeze()
    gc.enable()
    function(*arguments)


def end_when_told() -> None:
    """Make this worker end on SIGTERM, once `in_worker` has cleaned up; interrupts are left to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, _end)
    raise_lost_signals_again()


def in_worker(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Result of a call; on SIGTERM, Terminated is raised in it, and this process ends when it has cleaned up.

    An exception alone would only end the call: the loop of a pool's worker catches every one, and would wait for
    another call while its parent waits for it. A call that catches Terminated is finished first.
    """
    global _is_called
    try:
        _is_called = True
        with ending_what_forked_off():
            result = function(*arguments)
    except Terminated:
        _exit()
    finally:
        _is_called = False
    if _told:
        _exit()
    return result


def end_children_at_exit() -> None:
    """Make this worker kill, when it ends, the processes that a tracker in it has forked and left.

    They would keep the output of the command open: one that reads it through a pipe would wait for them. Guards end by
    themselves, and then remove their folders.
    """
    Finalize(None, end_descendants, (is_guard,), exitpriority=0)


def start_resource_tracker() -> None:
    """Start multiprocessing's resource tracker, which tracks semaphores, such that SIGHUP does not kill it.

    It already ignores SIGINT and SIGTERM. If it is killed, multiprocessing starts another one without its records,
    which prints a traceback for each unknown name.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    handler = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # inherited through exec
    try:
        resource_tracker.ensure_running()
    finally:
        signal.signal(signal.SIGHUP, handler)


def _end(number: int, _: object) -> None:
    global _told
    _told = number
    if not _is_called:
        _exit()
    raise Terminated(128 + number)


def _exit() -> NoReturn:
    sys.stdout.flush()
    sys.stderr.flush()
    end_descendants(is_guard)
    os._exit(128 + _told)


def _end_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
