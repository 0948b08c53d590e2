"""The encoders of a camera's gimbal in flight, read as a sensor of the body."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.encoder import EncoderReader, rows_of
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.sensor import Table


@dataclass(frozen=True, eq=False)
class GimbalEncoders:
    """Encoders on the joints of a gimbal that moves along the flight in progress; a `LiveSensorSpec`."""

    gimbal: Gimbal
    motion: GimbalMotion

    @property
    def rate_hz(self) -> float:
        """Readings per second."""
        return self.gimbal.encoder.rate_hz

    @property
    def measured(self) -> tuple[str, ...]:
        """Columns that the vehicle has: the angles of the joints that exist."""
        return tuple(f"{joint}_rad" for joint in self.gimbal.joints)

    def measure(self, flight: Flight, obstacles: ObstacleMesh, rng: np.random.Generator) -> Table:
        """Measured and true angles along a whole flight."""
        return self.gimbal.encoder.measure(self.gimbal.joints, self.motion, flight, rng)

    def begin(self, readings: int, obstacles: ObstacleMesh, rng: np.random.Generator) -> "JointReader":
        """Reader of the encoders in flight."""
        return JointReader(self, EncoderReader(self.gimbal.encoder, readings, rng))


class JointReader:
    """Reads the angles of the joints that exist."""

    def __init__(self, encoders: GimbalEncoders, reader: EncoderReader) -> None:
        self._motion, self._reader = encoders.motion, reader
        self._there = rows_of(encoders.gimbal.joints)

    def read(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """The next readings (n, k), rad."""
        return self._reader.read(self._motion.angles(stamps_ns))[:, self._there]
