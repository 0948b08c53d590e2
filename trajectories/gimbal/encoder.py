"""Encoders of a gimbal: the measured angles of its joints."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval

from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.sensor import Table, check_rate, sample_stamps


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """An absolute encoder on each joint; the defaults are those of ams' AS5048A (data sheet v1-06, 2014), 14 bits.

    A reading is the angle, a zero offset that is fixed during a flight, and white noise, rounded to resolution_deg (0:
    continuous). noise_deg is the noise's standard deviation, 0.06 degrees by the data sheet; zero_deg is that of the
    offsets, of which each joint has its own; 0.1 degrees after calibration is assumed. rate_hz is that at which an
    autopilot asks for them, assumed; the unit itself samples at 11 kHz.
    """

    rate_hz: Annotated[float, Interval(gt=0, le=500)] = 100.0
    noise_deg: Annotated[float, Interval(ge=0, le=10)] = 0.06
    resolution_deg: Annotated[float, Interval(ge=0, le=10)] = 360.0 / 2**14
    zero_deg: Annotated[float, Interval(ge=0, le=10)] = 0.1

    @property
    def white_rad(self) -> float:
        """Standard deviation of a reading about its offset, rad: noise, and rounding by up to half a step."""
        return math.radians(math.hypot(self.noise_deg, self.resolution_deg / math.sqrt(12.0)))

    @property
    def zero_rad(self) -> float:
        """Standard deviation of a joint's offset, rad."""
        return math.radians(self.zero_deg)

    def measure(self, joints: tuple[str, ...], motion: GimbalMotion, flight: Flight, rng: np.random.Generator) -> Table:
        """Measured angles of the named joints in rad, then the true ones as `true_...`.

        UserError for a rate at which the flight contains a single reading.
        """
        self.check(int(flight.stamps_ns[-1] - flight.stamps_ns[0]))
        stamps = sample_stamps(flight, self.rate_hz)
        true = motion.angles(stamps)
        read = EncoderReader(self, len(stamps), rng).read(true)
        there = rows_of(joints)
        columns = (*(f"{joint}_rad" for joint in joints), *(f"true_{joint}_rad" for joint in joints))
        return Table(columns, stamps, np.hstack([read[:, there], true[:, there]]))

    def check(self, flown_ns: int) -> None:
        """UserError for a rate at which a flight of a duration in ns contains a single reading."""
        check_rate(self.rate_hz, flown_ns, key="encoder.rate_hz")


class EncoderReader:
    """Reads the encoders of yaw, roll and pitch joint in the order of their readings."""

    def __init__(self, encoder: Encoder, readings: int, rng: np.random.Generator) -> None:
        zero, noise, self._step = np.radians([encoder.zero_deg, encoder.noise_deg, encoder.resolution_deg])
        self._zeros = zero * rng.standard_normal(3)
        self._noise = noise * rng.standard_normal((readings, 3))
        self._done = 0

    def read(self, angles_rad: Array) -> Array:
        """The next readings (n, 3) of true angles (n, 3), rad."""
        first, self._done = self._done, self._done + len(angles_rad)
        read = angles_rad + self._zeros + self._noise[first : self._done]
        return np.asarray(np.round(read / self._step) * self._step if self._step > 0 else read)


def rows_of(joints: tuple[str, ...]) -> list[int]:
    """Indices of the named joints among yaw, roll and pitch."""
    return [("yaw", "roll", "pitch").index(joint) for joint in joints]
