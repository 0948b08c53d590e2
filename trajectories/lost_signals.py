"""Re-raises signal exceptions that were lost: in a C callback, or in a library that catches every exception.

An exception that a signal handler raises inside a callback from C (ctypes, a finalizer) is not propagated: Python
prints it and continues. And libraries catch what is raised while they import others: trimesh does, and would go on
without scipy.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from uavbench.trajectories.errors import Terminated

RETRY_S = 0.02
"""Time after which a lost exception is raised again; callbacks take microseconds."""
_lost: list[BaseException] = []
"""The exception that was lost in a callback."""
_raised: list[BaseException] = []
"""The exception that `raise_until_handled` raised, as long as it may be lost."""


def raise_lost_signals_again() -> None:
    """Install the hook that raises lost KeyboardInterrupt and Terminated again in the main thread."""

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if isinstance(unraisable.exc_value, KeyboardInterrupt | Terminated):
            _lost[:] = [unraisable.exc_value.with_traceback(None)]
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        else:
            sys.__unraisablehook__(unraisable)

    signal.signal(signal.SIGALRM, _raise_again)
    sys.unraisablehook = hook


def raise_until_handled(error: BaseException) -> NoReturn:
    """Raise an exception in a signal handler, and again when somebody has caught it and gone on.

    This ends with the context of `lost_signals_raised_again`. Code that cleans up while the exception passes is not
    disturbed.
    """
    _raised[:] = [error]
    signal.setitimer(signal.ITIMER_REAL, RETRY_S)
    raise error


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
        _raised.clear()
        _lost.clear()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        signal.signal(signal.SIGALRM, handler)


def _raise_again(*_: Any) -> None:
    error = next(iter((*_lost, *_raised)), None)
    _lost.clear()
    if error is None:
        return
    if _raised:
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)
    if not _passes(error):  # one that was lost in a finalizer may have been raised again, and pass
        raise error.with_traceback(None)


def _passes(error: BaseException) -> bool:
    """Whether an exception is being handled in this thread, or was while the one that is was raised."""
    handled, seen = sys.exception(), set[int]()
    while handled is not None and id(handled) not in seen:
        if handled is error:
            return True
        seen.add(id(handled))
        handled = handled.__context__
    return False
