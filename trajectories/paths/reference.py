"""Reference rows for the controller, planned ahead or generated in flight."""

from dataclasses import dataclass
from math import cos, sin
from typing import Protocol

import numpy as np

from uavbench.trajectories.geometry.vectors import cross, dot, length, scale, vector
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array, read_only
from uavbench.trajectories.vehicle.geometric_control import REFERENCE_COLUMNS
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, STEP_S


@dataclass(frozen=True, eq=False)
class VehicleState:
    """State of the vehicle that guidance receives: position and velocity (3,) in the world, yaw in rad."""

    position_m: Array
    velocity_m_s: Array
    yaw_rad: float


class Guidance(Protocol):
    """Source of the controller's reference rows, block by block, in order.

    Steps count from 0 at the first row of the record; `warm_up` steps before it are flown and not recorded.
    """

    @property
    def warm_up(self) -> int:
        """Steps flown before the record."""
        ...

    @property
    def steps(self) -> int:
        """Rows of the record."""
        ...

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        """Reference rows (count, 17) of steps first, first + 1, ...; `state` is None before the vehicle exists."""
        ...


@dataclass(frozen=True, eq=False)
class Planned:
    """A reference known before the flight; the vehicle rests at its start during the warm-up."""

    table: Array  # (steps, 17)
    warm_up: int = round(3.0 / STEP_S)

    @property
    def steps(self) -> int:
        """Rows of the record."""
        return len(self.table)

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        """Rows of the table; during the warm-up its first row, at rest."""
        at = np.arange(first, first + count)
        out = self.table[np.maximum(at, 0)]
        out[at < 0, 3:9] = 0.0
        out[at < 0, 10:] = 0.0
        return out


@dataclass(frozen=True, eq=False)
class Replay:
    """A known motion: the record (n, 30) of a flight, columns as in `RECORD`."""

    record: Array


def planned(positions_m: Array, yaws_rad: Array) -> Planned:
    """Plan of smooth positions (n, 3) and unwrapped yaws (n,), one per control step, beginning at rest.

    Derivatives are central differences.
    """
    table = np.zeros((len(positions_m), REFERENCE_COLUMNS))
    velocity = _derivative(positions_m)
    acceleration = _derivative(velocity)
    table[:, 0:3], table[:, 3:6], table[:, 6:9], table[:, 9] = positions_m, velocity, acceleration, yaws_rad
    fill_rates(table, _derivative(acceleration), _derivative(yaws_rad))
    table[:, 13:16] = _derivative(table[:, 10:13])
    return Planned(read_only(table))


@compiled("f2! f2 f1")
def fill_rates(table: Array, jerk: Array, yaw_rate: Array) -> None:
    """Fill body rates 10:13 and the rate of the specific thrust 16 of reference rows (n, 17) from their accelerations.

    jerk (n, 3), yaw_rate (n,). Position and yaw are flat outputs of a quadrotor (Mellinger & Kumar 2011, section III).
    """
    for k in range(table.shape[0]):
        force = (table[k, 6], table[k, 7], table[k, 8] + GRAVITY_M_S2)
        size, yaw = length(force), table[k, 9]
        b3 = scale(1.0 / size, force)
        heading = (cos(yaw), sin(yaw), 0.0)
        side = cross(b3, heading)
        b2 = scale(1.0 / length(side), side)
        b1 = cross(b2, b3)
        j = vector(jerk[k])
        p, q = -dot(j, b2) / size, dot(j, b1) / size
        # The heading keeps to the plane of b1 and b3: d/dt (heading . b2) = 0 gives the third rate.
        r = (yaw_rate[k] * dot((-sin(yaw), cos(yaw), 0.0), b2) + p * dot(heading, b3)) / dot(heading, b1)
        table[k, 10], table[k, 11], table[k, 12], table[k, 16] = p, q, r, dot(j, b3)


def _derivative(values: Array) -> Array:
    return np.asarray(np.gradient(values, STEP_S, axis=0))
