"""Encoders of a gimbal: the measured angles of its joints."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.sensors.sensor import Table, sample_stamps


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

    def measure(self, joints: tuple[str, ...], motion: GimbalMotion, flight: Flight, rng: np.random.Generator) -> Table:
        """Measured angles of the named joints in rad, then the true ones as `true_...`.

        UserError for a rate at which the flight contains a single reading.
        """
        flown_s = float(flight.stamps_ns[-1] - flight.stamps_ns[0]) / 1e9
        if len(flight) > 1 and self.rate_hz * flown_s < 1:
            raise UserError(
                f"encoder.rate_hz {self.rate_hz:g}: one reading takes {1 / self.rate_hz:g} s, and the flight "
                f"{flown_s:g} s; raise rate_hz, or fly longer"
            )
        stamps = sample_stamps(flight, self.rate_hz)
        true = motion.angles(stamps)
        zero, noise, step = np.radians([self.zero_deg, self.noise_deg, self.resolution_deg])
        read = true + zero * rng.standard_normal(3) + noise * rng.standard_normal(true.shape)
        if step > 0:
            read = np.round(read / step) * step
        there = [("yaw", "roll", "pitch").index(joint) for joint in joints]
        columns = (*(f"{joint}_rad" for joint in joints), *(f"true_{joint}_rad" for joint in joints))
        return Table(columns, stamps, np.hstack([read[:, there], true[:, there]]))
