"""Wall-clock time of the stages of one frame."""

from time import perf_counter


class Stage:
    """Context whose duration is added to a stage of `ms`; a class, since a generator takes three times as long."""

    __slots__ = ("begin", "ms", "name")

    def __init__(self, ms: dict[str, float], name: str) -> None:
        self.ms, self.name = ms, name

    def __enter__(self) -> None:
        self.begin = perf_counter()

    def __exit__(self, *error: object) -> None:
        ms, name = self.ms, self.name
        ms[name] = ms.get(name, 0.0) + (perf_counter() - self.begin) * 1e3


class StageClock:
    """Adds up the time of each named stage in `ms`."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}

    def stage(self, name: str) -> Stage:
        """Context whose duration is added to a stage."""
        return Stage(self.ms, name)
