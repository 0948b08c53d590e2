"""Latency models: delay until the tracker's result of a frame reaches the vehicle's filter."""

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
from annotated_types import Ge, Gt

from uavbench.trajectories.errors import UserError

MS_NS = 1e6
"""Nanoseconds in a millisecond."""


class LatencySpec(Protocol):
    """A latency model: a frozen dataclass of its parameters.

    occupies: whether the tracker is busy for the whole delay, which then begins when the frame is fully exposed, so
    that frames arriving meanwhile are dropped; otherwise the delay begins at the frame's stamp.
    """

    occupies: ClassVar[bool]

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """Delay in ns of a frame's result, from its begin; took_ms: wall-clock time of tracking it."""
        ...


@dataclass(frozen=True)
class Constant:
    """The same latency for every frame, independent of the machine."""

    occupies: ClassVar[bool] = False
    ms: Annotated[float, Ge(0)] = 50.0

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """The constant delay in ns."""
        return round(self.ms * MS_NS)


@dataclass(frozen=True)
class Lognormal:
    """A lognormal latency with a median and a spread, the standard deviation of its logarithm; results may overtake."""

    occupies: ClassVar[bool] = False
    median_ms: Annotated[float, Gt(0)] = 50.0
    spread: Annotated[float, Ge(0)] = 0.3

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """A random delay in ns."""
        return round(self.median_ms * float(np.exp(self.spread * rng.standard_normal())) * MS_NS)


@dataclass(frozen=True)
class Measured:
    """The measured wall-clock time of the frame times `scale`, plus more_ms for camera and link, from its exposure on.

    Frames that arrive while the tracker is busy are dropped.
    """

    occupies: ClassVar[bool] = True
    scale: Annotated[float, Gt(0)] = 1.0
    more_ms: Annotated[float, Ge(0)] = 0.0

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> int:
        """The scaled wall-clock time in ns."""
        return round((self.scale * took_ms + self.more_ms) * MS_NS)


LATENCIES: dict[str, type[LatencySpec]] = {"constant": Constant, "lognormal": Lognormal, "measured": Measured}
"""Name -> latency model."""


def delay_of(latency: LatencySpec, took_ms: float, rng: np.random.Generator) -> int:
    """Delay of a result, ns; UserError for a user's latency that is no time, or that differs when it is asked again."""
    if type(latency) in LATENCIES.values():
        return latency.delay_ns(took_ms, rng)
    name = f"latency {type(latency).__module__}:{type(latency).__name__}"
    if not isinstance(getattr(latency, "occupies", None), bool):
        raise UserError(f"{name}: needs `occupies: ClassVar[bool]`, whether the tracker is busy for the whole delay")
    twin = deepcopy(rng)
    delay: Any = latency.delay_ns(took_ms, rng)
    again = latency.delay_ns(took_ms, twin)
    if not isinstance(delay, int | float | np.number) or not 0 <= delay < math.inf:
        raise UserError(f"{name}: delay_ns gives {delay!r}; it takes nanoseconds, 0 or more")
    if delay != again:
        raise UserError(
            f"{name}: delay_ns gives another delay each time; take all random numbers from the `rng` that it is given, "
            "and nothing from the clock or an earlier call"
        )
    return round(float(delay))
