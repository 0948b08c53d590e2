"""The Crazyflie's flow deck: optical flow of the floor (PMW3901) and range to it (VL53L1x)."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Array, rotation_from_quaternion
from uavbench.trajectories.sensors.sensor import Reader, Table, check_limits, sample_stamps, sampled

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh


@dataclass(frozen=True)
class FlowDeck:
    """Downward optical flow and range along the body's -z: image motion in px since the last reading, and distance.

    Flow follows the measurement model of the Crazyflie's firmware (mm_flow.c): pixels / aperture_rad per radian of
    flow, v_x / range - w_y along x and v_y / range + w_x along y, where its two constants are 35 px and 0.71674 rad.
    Counts are integers, as from the chip, with the remainder carried over; flow_noise_px is their noise, 0.25 px as
    the firmware's filter first assumed (flowdeck_v1v2.c). Range noise follows zranger2.c: 2.5 mm, growing exponentially
    beyond 2.5 m to 0.2 m at 4 m, the maximum range. Below least_range_m the chip measures no flow (PMW3901 data sheet:
    from 80 mm).
    """

    measured: ClassVar[tuple[str, ...]] = ("dx_px", "dy_px", "range_m")

    rate_hz: Annotated[float, Gt(0), Le(500)] = 50.0
    pixels: Annotated[float, Gt(0)] = 35.0
    aperture_rad: Annotated[float, Gt(0)] = 0.71674
    flow_noise_px: Annotated[float, Ge(0)] = 0.25
    range_noise_m: Annotated[float, Ge(0)] = 0.0025
    least_range_m: Annotated[float, Ge(0)] = 0.08
    greatest_range_m: Annotated[float, Gt(0)] = 4.0

    def __post_init__(self) -> None:
        check_limits(self.least_range_m, self.greatest_range_m)

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Flow dx, dy in px (integer counts) and range in m; none where the ground is out of range."""
        stamps = sample_stamps(flight, self.rate_hz)
        return Table(self.measured, stamps, self.begin(len(stamps), obstacles, rng).read(flight, stamps))

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Reader:
        """Reader of the deck in flight."""
        return FlowReader(self, obstacles, rng)


class FlowReader:
    """Reader of a flow deck in flight; it carries over fractions of counts."""

    def __init__(self, deck: FlowDeck, obstacles: "ObstacleMesh", rng: np.random.Generator) -> None:
        self._deck, self._obstacles = deck, obstacles
        self._flow_rng, self._range_rng = rng.spawn(2)
        self._total_px = np.zeros((1, 2))
        self._last_ns: int | None = None

    def read(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """The next readings (n, 3)."""
        deck = self._deck
        flow, distance = flow_ground_truth(flight, self._obstacles)
        # Flow accumulated since the last reading: the integral of the rate from row to row.
        step_s = np.diff(flight.stamps_ns, prepend=flight.stamps_ns[0])[:, None] / 1e9
        before = np.concatenate([flow[:1], flow[:-1]])
        gathered = np.cumsum(np.nan_to_num(0.5 * (flow + before)) * step_s, axis=0)
        last_ns = int(flight.stamps_ns[0]) if self._last_ns is None else self._last_ns
        angle = np.diff(sampled(flight, gathered, np.concatenate([[last_ns], stamps_ns])), axis=0)
        seen = sampled(flight, distance[:, None], stamps_ns)[:, 0]
        added = deck.pixels / deck.aperture_rad * angle
        added = added + deck.flow_noise_px * self._flow_rng.standard_normal(angle.shape)
        total = np.cumsum(np.concatenate([self._total_px, added]), axis=0)
        counts = np.diff(np.round(total), axis=0) + 0.0
        self._total_px, self._last_ns = total[-1:], int(stamps_ns[-1])
        growth = math.log(0.2 / 0.0025) / (4.0 - 2.5)
        sigma = deck.range_noise_m * (1.0 + exact.exp(growth * (np.minimum(seen, deck.greatest_range_m) - 2.5)))
        ranged = seen + sigma * self._range_rng.standard_normal(len(seen))
        ranged = np.where(seen <= deck.greatest_range_m, ranged, np.nan)
        counts[(seen > deck.greatest_range_m) | (seen < deck.least_range_m)] = np.nan
        return np.column_stack([counts, ranged])


class FlowGroundTruth(NamedTuple):
    """Flow rates (n, 2) in rad/s of the surface along the body's -z, and distances (n,) to it in metres."""

    rates_rad_s: Array
    distances_m: Array


def flow_ground_truth(flight: Flight, obstacles: "ObstacleMesh") -> FlowGroundTruth:
    """Flow and distance at each row of a flight.

    The surface is the structure or the floor at z = 0, whichever is nearer; inf when the body is upside down.
    """
    R = rotation_from_quaternion(flight.quaternions_wxyz)
    down = -R[:, :, 2]
    falling = np.minimum(down[:, 2], -1e-9)
    to_floor = np.where(down[:, 2] < 0, -flight.positions_m[:, 2] / falling, np.inf)
    distance = np.minimum(obstacles.ray(flight.positions_m, down), to_floor)
    v = np.einsum("nji,nj->ni", R, flight.velocities_m_s)
    w = flight.angular_velocities_rad_s
    flow = np.column_stack([v[:, 0] / distance - w[:, 1], v[:, 1] / distance + w[:, 0]])
    return FlowGroundTruth(flow, distance)
