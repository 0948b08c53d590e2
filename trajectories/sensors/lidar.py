"""Scanning lidars with one or several rings."""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Interval, Le
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.ranging import LaserRanging
from uavbench.trajectories.sensors.sensor import Table

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh

MOST_RINGS = 128
"""Rings of the largest lidars on the market."""
RING_COLUMNS = tuple(f"range_{ring:02d}_m" for ring in range(MOST_RINGS))


@dataclass(frozen=True)
class Lidar2d(LaserRanging):
    """A lidar that scans about its z axis; the defaults are those of Hokuyo's UTM-30LX by its data sheet.

    It makes rate_hz scans a second, from -field_deg / 2 to field_deg / 2 counter-clockwise about x, in steps of
    step_deg: 40 scans, 270 degrees, 0.25 degrees. Range 0.1 m to 30 m on white paper, taken as 90 % reflectance, with a
    standard deviation of 10 mm up to 10 m and 30 mm beyond, in steps of 1 mm. elevations_deg are those of its rings,
    from below; a step measures all rings at once. Each step has its own stamp and the pose of the vehicle at that time.
    """

    measured: ClassVar[tuple[str, ...]] = ("azimuth_rad", *RING_COLUMNS)
    binary: ClassVar[bool] = True

    rate_hz: Annotated[float, Gt(0), Le(500)] = 40.0
    least_range_m: Annotated[float, Ge(0)] = 0.1
    greatest_range_m: Annotated[float, Gt(0)] = 30.0
    rated_reflectance: Annotated[float, Interval(gt=0, le=1)] = 0.9
    noise_m: Annotated[float, Ge(0)] = 0.01
    far_m: Annotated[float, Ge(0)] = 10.0
    far_noise_m: Annotated[float, Ge(0)] = 0.03
    resolution_m: Annotated[float, Ge(0)] = 0.001
    field_deg: Annotated[float, Interval(gt=0, le=360)] = 270.0
    step_deg: Annotated[float, Interval(ge=0.01, le=120)] = 0.25
    elevations_deg: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.elevations_deg) <= MOST_RINGS or not np.all(np.abs(self.elevations_deg) <= 90):
            raise ValueError(f"elevations_deg: give 1 to {MOST_RINGS} angles from -90 to 90")
        for below, above in pairwise(self.elevations_deg):
            if not below < above:
                raise ValueError(
                    f"elevations_deg: {above:g} follows {below:g}; name each ring once, from the lowest up"
                )

    @property
    def azimuths_rad(self) -> Array:
        """Azimuths (n,) of the steps of one scan, rad."""
        steps = int(self.field_deg / self.step_deg + 1e-9)
        steps += self.field_deg < 360.0  # a full turn has no last step, which would repeat the first
        return np.asarray(np.radians(-self.field_deg / 2 + self.step_deg * np.arange(max(steps, 1))))

    @property
    def steps_per_s(self) -> float:
        """Steps per second, each of which is a row of the readings."""
        return self.rate_hz * len(self.azimuths_rad)

    @property
    def rays_per_s(self) -> float:
        """Rays per second."""
        return self.steps_per_s * len(self.elevations_deg)

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Azimuth, range of each ring at each step (none without a return), and the true ranges."""
        self.check(flight, obstacles)
        stamps, azimuths = self._steps(flight)
        rings = len(self.elevations_deg)
        ways = self._ways(azimuths)
        values = self.ranges(flight, stamps, ways, rng.standard_normal((len(stamps), rings)), obstacles)
        names = RING_COLUMNS[:rings]
        columns = ("azimuth_rad", *names, *(f"true_{name}" for name in names))
        return Table(columns, stamps, np.column_stack([azimuths, values]))

    def _steps(self, flight: Flight) -> tuple[NDArray[np.int64], Array]:
        """Stamps and azimuths (n,) of all steps of the scans that end within the flight."""
        first, last = int(flight.stamps_ns[0]), int(flight.stamps_ns[-1])
        period = Fraction(10**9) / Fraction(str(self.rate_hz))
        turns = int(Fraction(last - first) / period)
        if turns == 0:
            raise UserError(f"rate_hz {self.rate_hz:g}: the flight ends before the first scan does; raise rate_hz")
        azimuths = self.azimuths_rad
        begins = np.array([first + round(k * period) for k in range(turns)], dtype=np.int64)
        late = np.rint(np.arange(len(azimuths)) * float(period) * self.step_deg / 360.0).astype(np.int64)
        return (begins[:, None] + late).reshape(-1), np.tile(azimuths, turns)

    def _ways(self, azimuths_rad: Array) -> Array:
        """Unit ray directions (n, rings, 3) in the sensor frame."""
        level = np.column_stack([exact.cos(azimuths_rad), exact.sin(azimuths_rad), np.ones(len(azimuths_rad))])
        up = np.radians(np.array(self.elevations_deg))
        tilt = np.column_stack([exact.cos(up), exact.cos(up), exact.sin(up)])
        return np.asarray(level[:, None] * tilt[None])


@dataclass(frozen=True)
class Lidar3d(Lidar2d):
    """A lidar of 16 rings; the defaults are those of Velodyne's VLP-16 (user manual 63-9243 rev. D).

    10 scans a second (of 5 to 20), 360 degrees in steps of 0.2, rings from -15 to 15 degrees every 2, up to 100 m in
    steps of 2 mm; its typical accuracy of 3 cm is taken as one standard deviation. The manual names no target for the
    100 m; rated_reflectance 0.8 is assumed. The rings of the unit fire within 37 microseconds, here simultaneously.
    """

    rate_hz: Annotated[float, Gt(0), Le(500)] = 10.0
    greatest_range_m: Annotated[float, Gt(0)] = 100.0
    least_range_m: Annotated[float, Ge(0)] = 0.5
    rated_reflectance: Annotated[float, Interval(gt=0, le=1)] = 0.8
    noise_m: Annotated[float, Ge(0)] = 0.03
    far_noise_m: Annotated[float, Ge(0)] = 0.03
    resolution_m: Annotated[float, Ge(0)] = 0.002
    field_deg: Annotated[float, Interval(gt=0, le=360)] = 360.0
    step_deg: Annotated[float, Interval(ge=0.01, le=120)] = 0.2
    elevations_deg: tuple[float, ...] = tuple(float(k) for k in range(-15, 16, 2))
