"""A laser range finder: one ray, for height above ground or distance to a wall."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.ranging import LaserRanging
from uavbench.trajectories.sensors.sensor import Reader, RowByRow, Table, sample_stamps

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh


@dataclass(frozen=True)
class RangeFinder(LaserRanging):
    """Laser range finder along the sensor's x axis; the defaults are those of Garmin's LIDAR-Lite v3 (manual, 2016).

    40 m on a target of 70 % reflectance, from 5 cm, in steps of 1 cm, up to 500 Hz; its accuracy of 2.5 cm below 5 m
    and of 10 cm beyond is taken as one standard deviation. Set pitch_deg = -90 for a downward one.
    """

    measured: ClassVar[tuple[str, ...]] = ("range_m",)

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Range in m (none without a return), and the true distance along the ray."""
        self.check(flight, obstacles)
        stamps = sample_stamps(flight, self.rate_hz)
        values = self._readings(obstacles, flight, stamps, rng.standard_normal((len(stamps), 1)))
        return Table(("range_m", "true_range_m"), stamps, values)

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Reader:
        """Reader of the range finder in flight."""
        return RowByRow(rng.standard_normal((readings, 1)), partial(self._readings, obstacles))

    def _readings(self, obstacles: "ObstacleMesh", flight: Flight, stamps_ns: NDArray[np.int64], noise: Array) -> Array:
        ways = np.tile([1.0, 0.0, 0.0], (len(stamps_ns), 1, 1))
        return self.ranges(flight, stamps_ns, ways, noise, obstacles)
