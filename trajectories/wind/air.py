"""The air along a flight."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Protocol

import numpy as np
from annotated_types import Interval

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh


FASTEST_M_S = 100.0
"""Fastest wind of a config, m/s: the fastest gust measured near the ground had 113 (Barrow Island, 1996)."""
WindSpeed = Annotated[float, Interval(ge=0, le=FASTEST_M_S)]
GustTime = Annotated[float, Interval(ge=0, le=600)]
"""A time of gusts, s."""


@dataclass(frozen=True, eq=False)
class Air:
    """Wind at each step of a flight: mean_m_s and turbulence_m_s (n, 3) in the world.

    Near the structure the turbulence is (1 + near_gain exp(-distance / near_m)) times as strong.
    """

    mean_m_s: Array
    turbulence_m_s: Array
    near_gain: float = 0.0
    near_m: float = 1.0

    def at(self, first: int, count: int, position_m: Array, obstacles: "ObstacleMesh") -> Array:
        """Wind (count, 3) of steps first, first + 1, ... at a position (3,), metres."""
        strength = 1.0
        if self.near_gain > 0.0:
            distance = float(obstacles.distance(position_m[None])[0])
            strength += self.near_gain * math.exp(-distance / self.near_m)
        rows = slice(first, first + count)
        return np.asarray(self.mean_m_s[rows] + strength * self.turbulence_m_s[rows])


class WindSpec(Protocol):
    """A kind of wind: a frozen dataclass of its parameters."""

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air of `steps` steps of step_s seconds."""
        ...


def check_air(kind: WindSpec, air: Air, steps: int) -> None:
    """UserError for air that is not there at each step of a flight, in numbers."""
    if not isinstance(air, Air):
        raise UserError(f"wind {type(kind).__name__}: start gives a {type(air).__name__}; it takes an Air")
    for name in ("mean_m_s", "turbulence_m_s"):
        values = getattr(air, name)
        if not isinstance(values, np.ndarray) or not np.issubdtype(values.dtype, np.floating):
            what = f"of {values.dtype}" if isinstance(values, np.ndarray) else f"a {type(values).__name__}"
            raise UserError(f"wind {type(kind).__name__}: {name} is {what}; it takes an array of floats {(steps, 3)}")
        if values.shape != (steps, 3):
            raise UserError(f"wind {type(kind).__name__}: {name} has the shape {values.shape}, not {(steps, 3)}")
        if not np.isfinite(values).all():
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            raise UserError(f"wind {type(kind).__name__}: {name} is not finite at step {row}")
    if not (0 <= air.near_gain < math.inf and 0 < air.near_m < math.inf):
        raise UserError(
            f"wind {type(kind).__name__}: near_gain {air.near_gain} and near_m {air.near_m} must be finite, the first "
            "0 or more, the second above 0"
        )


def downwind(from_deg: float) -> Array:
    """Unit vector (3,) along which a wind from `from_deg` blows."""
    angle = np.radians(from_deg)
    return np.array([-math.cos(angle), -math.sin(angle), 0.0])
