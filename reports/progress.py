"""Progress of a report."""

from collections.abc import Callable
from concurrent.futures import CancelledError
from threading import Lock

OnStep = Callable[[int, int], None]


class Steps:
    """Thread-safe progress of a report, in units of one overlay frame."""

    def __init__(self, on_step: OnStep | None, total: int) -> None:
        self._on_step = on_step
        self._total = total
        self._done = 0
        self._stopped = False
        self._lock = Lock()

    def __call__(self, weight: int = 1) -> None:
        """Add completed work; CancelledError after `stop`."""
        if self._stopped:
            raise CancelledError
        with self._lock:
            self._tell(min(self._done + weight, self._total))

    def stop(self) -> None:
        """End the work at its next step."""
        self._stopped = True

    def finish(self) -> None:
        """Report that all is done."""
        self._tell(self._total)

    def _tell(self, done: int) -> None:
        self._done = done
        if self._on_step is not None:
            self._on_step(self._done, self._total)
