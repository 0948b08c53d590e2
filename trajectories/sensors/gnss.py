"""GNSS receiver with satellites occluded by the structure."""

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Interval, Le
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import refuse_idle
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Angle, Array
from uavbench.trajectories.sensors.satellites import PER_PLANE, PLANES, sky
from uavbench.trajectories.sensors.sensor import Reader, RowByRow, Table, sample_stamps, sampled
from uavbench.trajectories.wind.dryden import first_order

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh

SATELLITES = PLANES * PER_PLANE


class SatelliteView(NamedTuple):
    """Unit vectors (n, 24, 3) to the satellites in the world, and which of them (n, 24) are in view."""

    directions: Array
    in_view: NDArray[np.bool_]


@dataclass(frozen=True)
class Gnss:
    """Position fixes from the satellites in view: above the mask angle mask_deg and not occluded by the structure.

    Each pseudorange has a correlated error (slow_m, time constant slow_s: orbit, clock, atmosphere, multipath) and
    white noise (white_m); a fix is the least-squares solution of those in view, so that it degrades with the geometry
    and jumps when a satellite is lost. Fewer than four satellites, or a position dilution of precision above
    greatest_pdop, give no fix. Velocity is solved from range rates with errors of doppler_m_s. The sky is that over
    latitude_deg at epoch_s; the world's y axis points north_deg counter-clockwise from north. Defaults are of the size
    of the GPS standard's user range error (SPS performance standard 2020: up to 2 m RMS single satellite).
    """

    measured: ClassVar[tuple[str, ...]] = (
        "satellites", "pdop", "px_m", "py_m", "pz_m", "vx_m_s", "vy_m_s", "vz_m_s",
    )  # fmt: skip

    rate_hz: Annotated[float, Gt(0), Le(500)] = 5.0
    mask_deg: Annotated[float, Interval(ge=0, lt=90)] = 10.0
    slow_m: Annotated[float, Ge(0)] = 1.0
    slow_s: Annotated[float, Gt(0)] = 300.0
    white_m: Annotated[float, Ge(0)] = 0.3
    doppler_m_s: Annotated[float, Ge(0)] = 0.05
    greatest_pdop: Annotated[float, Gt(1)] = 12.0
    latitude_deg: Annotated[float, Interval(ge=-90, le=90)] = 40.8
    north_deg: Angle = 0.0
    epoch_s: Annotated[float, Ge(0)] = 0.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"slow_s": ("slow_m",)})

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Satellites in view and dilution of precision; position and velocity in the world where there is a fix."""
        stamps = sample_stamps(flight, self.rate_hz)
        return Table(self.measured, stamps, self.begin(len(stamps), obstacles, rng).read(flight, stamps))

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Reader:
        """Reader of the receiver in flight."""
        return RowByRow(self._noise(readings, rng), partial(self._readings, obstacles))

    def _noise(self, n: int, rng: np.random.Generator) -> Array:
        """Errors (n, 48) of the ranges to the satellites, m, and of their rates, m/s."""
        white_rng, doppler_rng, *each = rng.spawn(2 + SATELLITES)
        slow = [first_order(n, 1.0 / self.rate_hz, self.slow_s, slow_rng) for slow_rng in each]
        ranges = self.slow_m * np.column_stack(slow) + self.white_m * white_rng.standard_normal((n, SATELLITES))
        return np.hstack([ranges, self.doppler_m_s * doppler_rng.standard_normal((n, SATELLITES))])

    def _readings(self, obstacles: "ObstacleMesh", flight: Flight, stamps_ns: NDArray[np.int64], noise: Array) -> Array:
        places = sampled(flight, flight.positions_m, stamps_ns)
        speeds = sampled(flight, flight.velocities_m_s, stamps_ns)
        sight, seen = self.view(places, stamps_ns, obstacles)
        ranges, dopplers = noise[:, :SATELLITES], noise[:, SATELLITES:]
        values = np.full((len(stamps_ns), 8), np.nan)
        values[:, 0] = seen.sum(axis=1)
        for i in np.flatnonzero(values[:, 0] >= 4):
            rows = np.column_stack([-sight[i, seen[i]], np.ones(int(values[i, 0]))])
            cofactor = exact.inverse(exact.product(rows.T, rows))
            pdop = math.sqrt(cofactor[0, 0] + cofactor[1, 1] + cofactor[2, 2])
            values[i, 1] = pdop
            if pdop <= self.greatest_pdop:
                solve = exact.product(cofactor, rows.T)
                values[i, 2:5] = places[i] + exact.product(solve, ranges[i, seen[i]])[:3]
                values[i, 5:8] = speeds[i] + exact.product(solve, dopplers[i, seen[i]])[:3]
        return values

    def view(self, places_m: Array, stamps_ns: NDArray[np.int64], obstacles: "ObstacleMesh") -> SatelliteView:
        """The satellites from places (n, 3) in the world, metres, at stamps (n,)."""
        east_north_up = sky(self.epoch_s + stamps_ns / 1e9, self.latitude_deg)
        c, s = math.cos(math.radians(self.north_deg)), math.sin(math.radians(self.north_deg))
        sight = exact.product(east_north_up, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
        seen = sight[..., 2] > math.sin(math.radians(self.mask_deg))
        fix, satellite = np.nonzero(seen)
        seen[fix, satellite] = np.isinf(obstacles.ray(places_m[fix], sight[fix, satellite]))
        return SatelliteView(sight, seen)
