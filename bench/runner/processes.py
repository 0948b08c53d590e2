"""Lifetime of worker processes: they end with the main process, and clean up on termination."""

import multiprocessing
import os
import signal
import threading
from multiprocessing import connection, resource_tracker

from uavbench.bench.external.guard_process import die_with
from uavbench.trajectories.errors import Terminated
from uavbench.trajectories.lost_signals import raise_lost_signals_again


def end_with_parent() -> None:
    """Have this worker end when the process that started it does, however that ends.

    The kernel sees to it on Linux; elsewhere, and should the thread that started it live on, a pipe to the parent does.
    """
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None:
        return
    die_with(parent.pid)
    threading.Thread(target=_end_after, args=(parent.sentinel,), name="parent-watch", daemon=True).start()


def hold_interrupts() -> None:
    """Hold back interrupts in this thread and in the processes that it starts, which import their modules first."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def end_when_told() -> None:
    """Have this worker clean up what is half-written and end at SIGTERM; an interrupt is its parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, _end)
    raise_lost_signals_again()


def start_resource_tracker() -> None:
    """Start the process in which multiprocessing keeps account of semaphores, so that a hang-up does not end it.

    It ignores interrupts and terminations by itself. One that was ended is started anew without its account, and prints
    a traceback for each name that it does not know.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    handler = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # inherited through exec
    try:
        resource_tracker.ensure_running()
    finally:
        signal.signal(signal.SIGHUP, handler)


def _end(number: int, _: object) -> None:
    raise Terminated(128 + number)


def _end_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
