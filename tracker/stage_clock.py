"""Wall-clock time of the stages of one frame."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class StageClock:
    """Adds up the time of each named stage in `ms`."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Context whose duration is added to a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.ms[name] = self.ms.get(name, 0.0) + (time.perf_counter() - begin) * 1e3
