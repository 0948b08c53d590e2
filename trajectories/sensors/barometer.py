"""Barometer of a small vehicle."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import refuse_idle
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.sensor import Reader, RowByRow, Table, sample_stamps, sampled
from uavbench.trajectories.wind.dryden import first_order

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh


@dataclass(frozen=True)
class Barometer:
    """Air pressure with white noise and a slow drift, and height above the floor by the standard atmosphere.

    noise_pa is the standard deviation of a reading, 1 Pa as in PX4's simulated barometer (sitl_gazebo, about 8 cm of
    height). The drift is a first-order Gauss-Markov process of drift_pa and drift_s, for doors, temperature and
    weather; it is 0 by default, as it depends on the site: estimate it from a record of your own sensor at rest.
    """

    measured: ClassVar[tuple[str, ...]] = ("pressure_pa", "height_m")

    rate_hz: Annotated[float, Gt(0), Le(500)] = 50.0
    noise_pa: Annotated[float, Ge(0)] = 1.0
    drift_pa: Annotated[float, Ge(0)] = 0.0
    drift_s: Annotated[float, Gt(0)] = 120.0
    floor_pressure_pa: Annotated[float, Gt(0)] = 101325.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"drift_s": ("drift_pa",)})

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Pressure in Pa and height above the floor in m."""
        stamps = sample_stamps(flight, self.rate_hz)
        return Table(self.measured, stamps, self._readings(flight, stamps, self._noise(len(stamps), rng)))

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Reader:
        """Reader of the barometer in flight."""
        return RowByRow(self._noise(readings, rng), self._readings)

    def _noise(self, n: int, rng: np.random.Generator) -> Array:
        """White noise and drift (n, 2) of the readings, Pa."""
        noise_rng, drift_rng = rng.spawn(2)
        noise = self.noise_pa * noise_rng.standard_normal(n)
        return np.column_stack([noise, self.drift_pa * first_order(n, 1.0 / self.rate_hz, self.drift_s, drift_rng)])

    def _readings(self, flight: Flight, stamps_ns: NDArray[np.int64], noise: Array) -> Array:
        height = sampled(flight, flight.positions_m, stamps_ns)[:, 2]
        pressure = pressure_at(height, self.floor_pressure_pa) + noise[:, 0] + noise[:, 1]
        return np.column_stack([pressure, height_at(pressure, self.floor_pressure_pa)])


TEMPERATURE_K, LAPSE_K_M, EXPONENT = 288.15, 0.0065, 5.25588
"""Standard atmosphere (ISO 2533) at sea level: temperature, lapse rate, and exponent g M / (R L)."""


def pressure_at(height_m: Array, floor_pressure_pa: float) -> Array:
    """Pressure (n,), Pa, at heights (n,) above the floor."""
    return np.asarray(floor_pressure_pa * exact.power(1.0 - LAPSE_K_M * height_m / TEMPERATURE_K, EXPONENT))


def height_at(pressure_pa: Array, floor_pressure_pa: float) -> Array:
    """Heights (n,), m, above the floor at pressures (n,): the inverse of `pressure_at`."""
    return np.asarray(TEMPERATURE_K / LAPSE_K_M * (1.0 - exact.power(pressure_pa / floor_pressure_pa, 1.0 / EXPONENT)))
