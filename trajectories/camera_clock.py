"""Exposure times of a vehicle's cameras, and the stamps of their frames."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.sensors.sensor import sample_stamps

MOST_JITTER = 0.4
"""Greatest jitter as a fraction of the frame period; below one half, so that frames stay in order."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Exposures:
    """Exposure times_ns (n,) of a camera's frames on the clock of the flight's record, and their stamps_ns (n,).

    Both mean the middle of the exposure; they differ by the offset of the camera's clock from that of the record.
    """

    times_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class CameraClock:
    """The clock that triggers and stamps the frames of all cameras of a vehicle.

    Frames are exposed every 1 / rate, to the nearest nanosecond, so that two rates share all common times. jitter_ms:
    standard deviation of the exposures about these times, at most MOST_JITTER of a period, included in the stamps.
    timeshift_cam_imu_s, as in Kalibr (t_imu = t_cam + shift): the clock's offset from that of the IMU, the other
    sensors and the flight's record. Stamps never fall below 0: with a positive shift the first frame is exposed at the
    time shift and stamped 0, with a negative one it is exposed at 0.
    """

    jitter_ms: Annotated[float, Interval(ge=0, le=100)] = 0.0
    timeshift_cam_imu_s: Annotated[float, Interval(ge=-10, le=10)] = 0.0

    def check(self, rate_hz: float) -> None:
        """UserError for a jitter that MOST_JITTER of the period of a rate would cut off for most frames."""
        most_ms = MOST_JITTER * 1e3 / rate_hz
        if self.jitter_ms > most_ms:
            raise UserError(
                f"jitter_ms {self.jitter_ms:g} is more than {most_ms:.3g}, {MOST_JITTER:g} of a period at rate_hz "
                f"{rate_hz:g}; lower it, or rate_hz"
            )

    @property
    def shift_ns(self) -> int:
        """The shift in whole ns."""
        return round(1e9 * self.timeshift_cam_imu_s)

    def exposures(self, flight: Flight, rate_hz: float, rng: np.random.Generator, offset_s: float = 0.0) -> Exposures:
        """Exposures of a camera at rate_hz, offset_s after those of the main one; pass the same rng for all cameras.

        UserError for a rate above that of the flight's record, and when there are not two frames.
        """
        times = self._times(flight, rate_hz, rng) + max(self.shift_ns, 0) + round(1e9 * offset_s)
        last = int(flight.stamps_ns[-1])
        times = times[times <= last]
        if len(times) < min(len(flight), 2):
            raise UserError(
                f"{len(times) or 'no'} frame is exposed in the {last / 1e9:g} s of the flight: its timeshift_cam_imu_s "
                f"or offset_s leaves no time for two at rate_hz {rate_hz:g}; lower it, or fly longer"
            )
        return Exposures(times_ns=times, stamps_ns=times - self.shift_ns)

    def _times(self, flight: Flight, rate_hz: float, rng: np.random.Generator) -> NDArray[np.int64]:
        stamps = flight.stamps_ns
        if len(stamps) > 1 and rate_hz * int(stamps[1] - stamps[0]) > 1e9:
            raise UserError(
                f"rate_hz {rate_hz:g}: the flight has {1e9 / int(stamps[1] - stamps[0]):g} steps a second; choose a "
                "rate of at most that"
            )
        times = sample_stamps(flight, rate_hz, "frame")
        if self.jitter_ms > 0.0:
            most = MOST_JITTER * 1e9 / rate_hz
            late = np.clip(1e6 * self.jitter_ms * rng.standard_normal(len(times)), -most, most)
            times = np.clip(times + np.rint(late).astype(np.int64), stamps[0], stamps[-1])
        return times
