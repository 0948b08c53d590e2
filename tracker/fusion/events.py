"""Events of the vehicle's filter, its state after each of them, and the outcome of each measurement."""

from dataclasses import dataclass
from typing import NamedTuple

from uavbench.trajectories.pose import Array, Pose


class Key(NamedTuple):
    """Sort key of events: stamp, rank at equal stamps, and order of arrival at equal ranks."""

    stamp_ns: int
    rank: int
    arrival: int


class Sample(NamedTuple):
    """One IMU reading (6,): body rate in rad/s, specific force in m/s^2."""

    reading: Array

    @property
    def gyro(self) -> Array:
        """Body rate (3,), rad/s."""
        return self.reading[0:3]


@dataclass(frozen=True)
class Verdict:
    """Outcome of a measurement.

    d2: its squared normalized innovation, dof its degrees of freedom; both None if it was not tested. why: reason of
    its rejection, empty when it was accepted.
    """

    stamp_ns: int
    kind: str
    d2: float | None
    dof: int | None
    why: str = ""


class Checkpoint(NamedTuple):
    """State of the filter right after an event, from which later events can be replayed."""

    stamp_ns: int
    state: Array
    P: Array
    sample: Sample | None
    refused: int
    verdict: Verdict | None


class Nominal(NamedTuple):
    """Nominal state (27,), and angular velocity (3,) in the body, rad/s."""

    state: Array
    angular_velocity_rad_s: Array


class PredictedCamera(NamedTuple):
    """Predicted `cam_from_world`, and the covariance (6, 6) of its twist."""

    cam_from_world: Pose
    covariance: Array


class Since(NamedTuple):
    """Last event before a stamp, and the IMU reading at the stamp, None before the first sample."""

    before: Checkpoint
    sample: Sample | None


class Carried(NamedTuple):
    """State and covariance at a stamp, and the IMU reading there, None before the first sample."""

    state: Array
    P: Array
    sample: Sample | None
