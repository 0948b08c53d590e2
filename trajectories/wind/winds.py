"""Registry of wind models by name, and the models without turbulence."""

from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import UserError, refuse_idle
from uavbench.trajectories.pose import Angle, read_only
from uavbench.trajectories.wind.air import Air, GustTime, WindSpec, WindSpeed, check_air, downwind
from uavbench.trajectories.wind.dryden import Dryden

__all__ = ["WINDS", "Dryden", "Gust", "Steady", "Still", "WindSpec", "air_of"]


LONGEST_S = 10_000.0
"""Latest first gust and largest interval, s: that of the longest flight."""


@dataclass(frozen=True)
class Still:
    """No wind."""

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air at rest."""
        calm = read_only(np.zeros((steps, 3)))
        return Air(calm, calm)


@dataclass(frozen=True)
class Steady:
    """Constant wind of speed_m_s from from_deg, which counts counter-clockwise from the world's x axis."""

    speed_m_s: WindSpeed = 2.0
    from_deg: Angle = 0.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"from_deg": ("speed_m_s",)})

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """The same wind at every step."""
        mean = read_only(np.tile(self.speed_m_s * downwind(self.from_deg), (steps, 1)))
        return Air(mean, read_only(np.zeros((steps, 3))))


@dataclass(frozen=True)
class Gust:
    """Steady wind with 1-cosine gusts on top of it (MIL-F-8785C, 3.7.1.3): rise, hold and fall.

    The first comes first_s after take-off (the record begins some seconds later), then one every every_s, each shifted
    randomly by up to jitter_s. from_deg counts counter-clockwise from the world's x axis. UserError for a first_s
    other than the default that the flight does not reach.
    """

    speed_m_s: WindSpeed = 1.0
    gust_m_s: WindSpeed = 2.0
    from_deg: Angle = 0.0
    first_s: Annotated[float, Interval(ge=0, le=LONGEST_S)] = 5.0
    every_s: Annotated[float, Interval(ge=0.1, le=LONGEST_S)] = 12.0
    jitter_s: GustTime = 2.0
    rise_s: Annotated[float, Interval(gt=0, le=600)] = 1.0
    hold_s: GustTime = 1.5

    def __post_init__(self) -> None:
        times = ("first_s", "every_s", "jitter_s", "rise_s", "hold_s")
        refuse_idle(self, dict.fromkeys(times, ("gust_m_s",)) | {"from_deg": ("speed_m_s", "gust_m_s")})

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air of `steps` steps of step_s seconds."""
        now = np.arange(steps) * step_s
        asked = self.gust_m_s and self.first_s != Gust.first_s
        if asked and self.first_s - self.jitter_s >= steps * step_s:
            raise UserError(
                f"wind gust: first_s {self.first_s:g}: no gust comes before the end of the flight, which with its "
                f"take-off takes {steps * step_s:g} s; lower it, fly longer, or leave the gusts out"
            )
        strength = np.zeros(steps)
        for begin in np.arange(self.first_s, steps * step_s, self.every_s):
            since = now - begin - rng.uniform(-self.jitter_s, self.jitter_s)
            up = np.clip(since / self.rise_s, 0.0, 1.0)
            down = np.clip((since - self.rise_s - self.hold_s) / self.rise_s, 0.0, 1.0)
            strength = np.maximum(strength, 0.5 * (exact.cos(np.pi * down) - exact.cos(np.pi * up)))
        wind = (self.speed_m_s + self.gust_m_s * strength)[:, None] * downwind(self.from_deg)
        return Air(read_only(wind), read_only(np.zeros((steps, 3))))


WINDS: dict[str, type[WindSpec]] = {"still": Still, "steady": Steady, "gust": Gust, "dryden": Dryden}


def air_of(kind: WindSpec, steps: int, step_s: float, rng: np.random.Generator) -> Air:
    """Air of `steps` steps of step_s seconds; UserError as `check_air`, and for a user's that is another each time.

    One that draws from more than the generator given to it makes another flight in every run of one seed.
    """
    if type(kind) in WINDS.values():
        return kind.start(steps, step_s, rng)
    air, again = (kind.start(steps, step_s, deepcopy(rng)) for _ in range(2))
    check_air(kind, air, steps)
    check_air(kind, again, steps)
    for name in ("mean_m_s", "turbulence_m_s", "near_gain", "near_m"):
        if not np.array_equal(getattr(air, name), getattr(again, name)):
            raise UserError(
                f"wind {type(kind).__name__}: start gives another {name} each time; take all random numbers from the "
                "`rng` that it is given, and nothing from the clock or an earlier call"
            )
    return air
