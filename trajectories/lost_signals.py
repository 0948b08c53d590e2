"""Re-raises signal exceptions that were lost in a C callback.

An exception that a signal handler raises inside a callback from C (ctypes, a finalizer) is not propagated: Python
prints it and continues.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from uavbench.trajectories.errors import Terminated

RETRY_S = 0.02
"""Time after which a lost exception is raised again; callbacks take microseconds."""


def raise_lost_signals_again() -> None:
    """Install the hook that raises lost KeyboardInterrupt and Terminated again in the main thread."""
    lost: list[BaseException] = []

    def raise_again(*_: Any) -> None:
        if lost:
            raise lost.pop()

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if isinstance(unraisable.exc_value, KeyboardInterrupt | Terminated):
            lost[:] = [unraisable.exc_value.with_traceback(None)]
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        else:
            sys.__unraisablehook__(unraisable)

    signal.signal(signal.SIGALRM, raise_again)
    sys.unraisablehook = hook


@contextmanager
def lost_signals_raised_again() -> Iterator[None]:
    """The same within a context; no effect outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hook, handler = sys.unraisablehook, signal.getsignal(signal.SIGALRM)
    raise_lost_signals_again()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        signal.signal(signal.SIGALRM, handler)
