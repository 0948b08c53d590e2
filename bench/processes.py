"""The lives of this program's own processes: workers end with the main process, and its signals end it in order."""

import multiprocessing
import os
import signal
import threading
from multiprocessing import connection

from bench.guard_process import die_with
from trajectories.errors import Terminated

ENDING = (signal.SIGTERM, signal.SIGHUP)
"""Signals that end a program as ^C does; SIGHUP comes when its terminal is gone."""


def end_with_parent() -> None:
    """Have this worker end when the process that started it does, however that ends.

    The kernel sees to it on Linux; elsewhere, and should the thread that started it live on, a pipe to the parent does.
    """
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None:
        return
    die_with(parent.pid)
    threading.Thread(target=_end_after, args=(parent.sentinel,), name="parent-watch", daemon=True).start()


def end_when_told() -> None:
    """Have this worker clean up what is half-written and end at SIGTERM; an interrupt is its parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)


def interrupt_on_signals() -> None:
    """Treat SIGTERM and SIGHUP as ^C, so that what is half-written is cleaned up; what nohup ignores stays ignored."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _end(number: int, _: object) -> None:
    raise Terminated(128 + number)


def _interrupt(number: int, _: object) -> None:
    raise KeyboardInterrupt(number)


def _end_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
