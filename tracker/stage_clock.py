"""Wall-clock time of the stages of one frame."""

import time


class Stage:
    """Context whose duration is added to a stage of `ms`; a class, since a generator takes three times as long."""

    __slots__ = ("begin", "ms", "name")

    def __init__(self, ms: dict[str, float], name: str) -> None:
        self.ms, self.name = ms, name

    def __enter__(self) -> None:
        self.begin = time.perf_counter()

    def __exit__(self, *error: object) -> None:
        self.ms[self.name] = self.ms.get(self.name, 0.0) + (time.perf_counter() - self.begin) * 1e3


class StageClock:
    """Adds up the time of each named stage in `ms`."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    def stage(self, name: str) -> Stage:
        """Context whose duration is added to a stage."""
        return Stage(self.ms, name)
