"""Wind: what the air does along a flight."""

from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from annotated_types import Ge

from trajectories.pose import Array, read_only
from trajectories.surroundings import Surroundings


@dataclass(frozen=True, eq=False)
class Air:
    """Wind at each step of a flight: mean_m_s and turbulence_m_s (n, 3) in the world.

    Near the structure the turbulence is (1 + near_gain exp(-distance / near_m)) times as strong.
    """

    mean_m_s: Array
    turbulence_m_s: Array
    near_gain: float = 0.0
    near_m: float = 1.0

    def at(self, first: int, count: int, position_m: Array, surroundings: Surroundings) -> Array:
        """Wind (count, 3) of steps first, first + 1, ... at a place (3,)."""
        strength = 1.0
        if self.near_gain > 0.0:
            distance = float(surroundings.distance(position_m[None])[0])
            strength += self.near_gain * float(np.exp(-distance / self.near_m))
        rows = slice(first, first + count)
        return np.asarray(self.mean_m_s[rows] + strength * self.turbulence_m_s[rows])


class WindSpec(Protocol):
    """A kind of wind: a frozen dataclass of its parameters."""

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air of `steps` steps of step_s seconds."""
        ...


@dataclass(frozen=True)
class Still:
    """No wind."""

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """Air at rest."""
        calm = read_only(np.zeros((steps, 3)))
        return Air(calm, calm)


@dataclass(frozen=True)
class Steady:
    """Wind of one speed from one side; from_deg counts counter-clockwise from the world's x axis."""

    speed_m_s: Annotated[float, Ge(0)] = 2.0
    from_deg: float = 0.0

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        """The same wind at every step."""
        mean = read_only(np.tile(self.speed_m_s * downwind(self.from_deg), (steps, 1)))
        return Air(mean, read_only(np.zeros((steps, 3))))


def downwind(from_deg: float) -> Array:
    """Unit vector (3,) along which a wind from `from_deg` blows."""
    angle = np.radians(from_deg)
    return np.array([-np.cos(angle), -np.sin(angle), 0.0])


WINDS: dict[str, type[WindSpec]] = {"still": Still, "steady": Steady}
