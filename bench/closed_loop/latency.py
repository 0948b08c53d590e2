"""How long after a frame's stamp the tracker's answer reaches the vehicle's filter."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

import numpy as np
from annotated_types import Ge, Gt

MS_NS = 1e6
"""Nanoseconds in a millisecond."""


class LatencySpec(Protocol):
    """A kind of latency: a frozen dataclass of its parameters.

    occupies: whether the tracker is at work for all of that time, so that frames that come meanwhile are not tracked.
    """

    occupies: ClassVar[bool]

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """Time from the stamp of a frame, which took_ms of wall time to track, to its answer."""
        ...


@dataclass(frozen=True)
class Constant:
    """The same latency at every frame: the flight does not depend on the machine that it is computed on."""

    occupies: ClassVar[bool] = False
    ms: Annotated[float, Ge(0)] = 50.0

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """The constant."""
        return round(self.ms * MS_NS)


@dataclass(frozen=True)
class Lognormal:
    """A random latency of a median and a spread, the standard deviation of its logarithm; answers may overtake."""

    occupies: ClassVar[bool] = False
    median_ms: Annotated[float, Gt(0)] = 50.0
    spread: Annotated[float, Ge(0)] = 0.3

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """The next one drawn."""
        return round(self.median_ms * float(np.exp(self.spread * rng.standard_normal())) * MS_NS)


@dataclass(frozen=True)
class Measured:
    """The wall time that the frame took on this machine times `scale`, and more_ms for camera and link.

    Frames that come while the tracker is at work are not tracked.
    """

    occupies: ClassVar[bool] = True
    scale: Annotated[float, Gt(0)] = 1.0
    more_ms: Annotated[float, Ge(0)] = 0.0

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """The time taken, scaled."""
        return round((self.scale * took_ms + self.more_ms) * MS_NS)


LATENCIES: dict[str, type[LatencySpec]] = {"constant": Constant, "lognormal": Lognormal, "measured": Measured}
"""The kinds of latency, by name."""
