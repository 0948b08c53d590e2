"""What a vehicle is told to do: reference rows for the controller, planned ahead or made in flight."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trajectories.control import REFERENCE_COLUMNS
from trajectories.pose import Array, read_only
from trajectories.quadrotor import GRAVITY_M_S2, STEP_S


@dataclass(frozen=True, eq=False)
class Seen:
    """The vehicle as its guidance sees it: position and velocity (3,) in the world, yaw in rad."""

    position_m: Array
    velocity_m_s: Array
    yaw_rad: float


class Guidance(Protocol):
    """Gives the controller its reference rows, block by block, in order.

    Steps count from 0 at the first row of the record; `warm_up` steps before it are flown and not recorded.
    """

    warm_up: int
    steps: int

    def rows(self, first: int, count: int, seen: Seen | None) -> Array:
        """Reference rows (count, 17) of steps first, first + 1, ...; `seen` is None before the vehicle exists."""
        ...


@dataclass(frozen=True, eq=False)
class Planned:
    """A reference known before the flight; the vehicle rests at its start during the warm-up."""

    table: Array  # (steps, 17)
    warm_up: int = round(2.0 / STEP_S)

    @property
    def steps(self) -> int:
        """Rows of the record."""
        return len(self.table)

    def rows(self, first: int, count: int, seen: Seen | None) -> Array:
        """Rows of the table; its first one, at rest, before it begins."""
        at = np.clip(np.arange(first, first + count), 0, len(self.table) - 1)
        out = self.table[at]
        resting = np.arange(first, first + count) < 0
        out[resting, 3:9] = 0.0
        out[resting, 10:] = 0.0
        return out


def planned(positions_m: Array, yaws_rad: Array) -> Planned:
    """Plan of smooth positions (n, 3) and unwrapped yaws (n,), one per control step, beginning at rest.

    Derivatives are central differences. Body rates and their derivatives follow from the flatness of the quadrotor
    (Mellinger & Kumar 2011, section III).
    """
    table = np.zeros((len(positions_m), REFERENCE_COLUMNS))
    velocity = _derivative(positions_m)
    acceleration = _derivative(velocity)
    jerk = _derivative(acceleration)
    table[:, 0:3], table[:, 3:6], table[:, 6:9], table[:, 9] = positions_m, velocity, acceleration, yaws_rad
    rates, thrust_rate = flat_rates(acceleration, jerk, yaws_rad, _derivative(yaws_rad))
    table[:, 10:13], table[:, 13:16], table[:, 16] = rates, _derivative(rates), thrust_rate
    return Planned(read_only(table))


def flat_rates(acceleration: Array, jerk: Array, yaw: Array, yaw_rate: Array) -> tuple[Array, Array]:
    """Body rates (n, 3), rad/s, and rates of the specific thrust (n,), m/s^3, of a motion without drag."""
    force = acceleration + np.array([0.0, 0.0, GRAVITY_M_S2])
    size = np.linalg.norm(force, axis=1)
    b3 = force / size[:, None]
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    b2 = np.cross(b3, heading)
    sine = np.linalg.norm(b2, axis=1)
    b2 /= sine[:, None]
    b1 = np.cross(b2, b3)
    turn = jerk / size[:, None]
    p, q = -np.einsum("ij,ij->i", turn, b2), np.einsum("ij,ij->i", turn, b1)
    # The heading stays in the plane of b1 and b3: d/dt (heading . b2) = 0 gives r.
    side = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros_like(yaw)])
    r = (yaw_rate * np.einsum("ij,ij->i", side, b2) + p * np.einsum("ij,ij->i", heading, b3)) / np.einsum(
        "ij,ij->i", heading, b1
    )
    return np.column_stack([p, q, r]), np.einsum("ij,ij->i", jerk, b3)


def _derivative(values: Array) -> Array:
    return np.asarray(np.gradient(values, STEP_S, axis=0))
