"""The lives of this program's own processes: workers end with the main process, in order."""

import multiprocessing
import os
import signal
import threading
from multiprocessing import connection

from uavbench.bench.external.guard_process import die_with
from uavbench.trajectories.errors import Terminated


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


def _end(number: int, _: object) -> None:
    raise Terminated(128 + number)


def _end_after(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
