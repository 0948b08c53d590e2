"""Progress of a report."""

from collections.abc import Callable

OnStep = Callable[[int, int], None]


class Steps:
    """Progress in frames of an overlay, or what takes as long."""

    def __init__(self, on_step: OnStep | None, total: int) -> None:
        self._on_step = on_step
        self._total = total
        self._done = 0

    def __call__(self, weight: int = 1) -> None:
        """Report that so much more is done."""
        self._tell(min(self._done + weight, self._total))

    def finish(self) -> None:
        """Report that all is done."""
        self._tell(self._total)

    def _tell(self, done: int) -> None:
        self._done = done
        if self._on_step is not None:
            self._on_step(self._done, self._total)
