"""Common base of laser range finders and lidars: mounting, ray casting, and range errors."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Gt, Interval, Le
from numpy.typing import NDArray

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import check_offset
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Angle, Array, rotation_exp, rotation_from_quaternion
from uavbench.trajectories.sensors.sensor import check_limits, check_rate, sampled

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh

EVERY = 5
"""Stride in rows of a flight, 10 ms, at which a sensor's position is checked."""
NOISIEST_M = 2.0
"""Largest noise and resolution, m: data sheets have 0.001 to 0.1; those of more than 2 mm are beyond if in mm."""
BLOCK = 65_536
"""Rays cast at a time: some 10 MB."""


@dataclass(frozen=True)
class LaserRanging:
    """Laser ranging: the distance to the first surface along an infinitely thin ray.

    The sensor's axes are the body's (x forward, y left, z up), rotated by yaw_deg (positive to the left), then
    pitch_deg (positive upwards: -90 looks down), then roll_deg; it is at offset_m on the body.

    A range r is measured where the returned power suffices. By the lidar equation for a Lambertian surface wider than
    the beam (Wagner et al. 2006, ISPRS J. 60; Hoefle & Pfeifer 2007, ISPRS J. 62) the returned power is proportional to
    reflectance cos(incidence) / r^2, and the least that is detected is that of the data sheet's target, of
    rated_reflectance at normal incidence at greatest_range_m: so r <= greatest_range_m sqrt(reflectance cos(incidence)
    / rated_reflectance), and r always lies between least_range_m and greatest_range_m. All surfaces have the same
    reflectance at the laser's wavelength; 0.3, a medium grey, is assumed. Range errors are normal with the standard
    deviation noise_m, far_noise_m from far_m on; readings come in steps of resolution_m (0: continuous).
    """

    rate_hz: Annotated[float, Gt(0), Le(500)] = 50.0
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    least_range_m: Annotated[float, Ge(0)] = 0.05
    greatest_range_m: Annotated[float, Gt(0)] = 40.0
    rated_reflectance: Annotated[float, Interval(gt=0, le=1)] = 0.7
    reflectance: Annotated[float, Interval(gt=0, le=1)] = 0.3
    noise_m: Annotated[float, Ge(0)] = 0.025
    far_m: Annotated[float, Ge(0)] = 5.0
    far_noise_m: Annotated[float, Ge(0)] = 0.1
    resolution_m: Annotated[float, Ge(0)] = 0.01

    def __post_init__(self) -> None:
        check_limits(self.least_range_m, self.greatest_range_m)
        check_offset(self.offset_m)
        if self.far_noise_m == self.noise_m and self.far_m != type(self).far_m:
            raise ValueError(
                f"far_m {self.far_m:g} has no effect: noise_m and far_noise_m are both {self.noise_m:g}; give another "
                "far_noise_m, or leave far_m out"
            )
        for name in ("noise_m", "far_noise_m", "resolution_m"):
            if getattr(self, name) > NOISIEST_M:
                raise ValueError(f"{name} {getattr(self, name):g} is more than {NOISIEST_M:g} m; give it in metres")

    @property
    def body_from_sensor(self) -> Array:
        """Rotation `body_from_sensor` (3, 3)."""
        yaw, pitch, roll = np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg])
        turns = rotation_exp(np.array([[0.0, 0.0, yaw], [0.0, -pitch, 0.0], [roll, 0.0, 0.0]]))
        return exact.product(exact.product(turns[0], turns[1]), turns[2])

    def check(self, flight: Flight, obstacles: "ObstacleMesh") -> None:
        """UserError when the sensor is inside the structure or under the floor, or its rate does not fit the flight."""
        check_rate(self.rate_hz, int(flight.stamps_ns[-1] - flight.stamps_ns[0]))
        stamps = flight.stamps_ns[::EVERY]
        places = self.places(flight, stamps)
        inside = obstacles.inside(places) | (places[:, 2] <= 0)
        if inside.any():
            at = int(np.argmax(inside))
            x, y, z = places[at]
            what = "under the floor" if z <= 0 else "inside the structure"
            raise UserError(
                f"t = {stamps[at] / 1e9:.2f} s, at ({x:.2f}, {y:.2f}, {z:.2f}) m: it is {what}; change its offset_m, "
                "or plan the path further away"
            )

    def places(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """Positions (n, 3) of the sensor in the world, metres."""
        turned = np.einsum("nij,j->ni", self.world_from_body(flight, stamps_ns), np.array(self.offset_m))
        return np.asarray(sampled(flight, flight.positions_m, stamps_ns) + turned)

    def world_from_body(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """Rotations (n, 3, 3) of the body at stamps (n,), between rows by linear interpolation of quaternions."""
        q = sampled(flight, same_sign(flight.quaternions_wxyz), stamps_ns)
        return rotation_from_quaternion(q / exact.length(q)[:, None])

    def ranges(
        self, flight: Flight, stamps_ns: NDArray[np.int64], ways: Array, noise: Array, obstacles: "ObstacleMesh"
    ) -> Array:
        """Measured and true ranges (n, 2 rings), metres, along unit directions (n, rings, 3) in the sensor frame.

        noise (n, rings) is standard normal. NaN without a return, and in the true ranges without a hit.
        """
        rings = ways.shape[1]
        out = np.empty((len(stamps_ns), 2 * rings))
        rows = max(BLOCK // rings, 1)
        for first in range(0, len(stamps_ns), rows):
            part = slice(first, first + rows)
            out[part] = self._block(flight, stamps_ns[part], ways[part], noise[part], obstacles)
        return out

    def _block(
        self, flight: Flight, stamps_ns: NDArray[np.int64], ways: Array, noise: Array, obstacles: "ObstacleMesh"
    ) -> Array:
        n, rings = ways.shape[:2]
        R = np.einsum("nij,jk->nik", self.world_from_body(flight, stamps_ns), self.body_from_sensor)
        directions = np.einsum("nij,nrj->nri", R, ways).reshape(-1, 3)
        origins = np.repeat(self.places(flight, stamps_ns), rings, axis=0)
        struck = obstacles.surfaces.strike(origins, directions, np.repeat(stamps_ns, rings))
        true = struck.distances_m.reshape(n, rings)
        reach = self.greatest_range_m * np.sqrt(self.reflectance * struck.cosines / self.rated_reflectance)
        back = (true >= self.least_range_m) & (true <= np.minimum(reach.reshape(n, rings), self.greatest_range_m))
        sigma = np.where(true < self.far_m, self.noise_m, self.far_noise_m)
        read = np.where(np.isfinite(true), true, 0.0) + sigma * noise
        if self.resolution_m > 0:
            read = np.round(read / self.resolution_m) * self.resolution_m
        return np.hstack([np.where(back, np.maximum(read, 0.0), np.nan), np.where(np.isfinite(true), true, np.nan)])


def same_sign(quaternions_wxyz: Array) -> Array:
    """Quaternions (n, 4) of the same rotations with signs such that successive ones have a positive dot product."""
    turns = np.einsum("ij,ij->i", quaternions_wxyz[1:], quaternions_wxyz[:-1]) < 0
    sign = np.concatenate([[1.0], np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)])
    return np.asarray(quaternions_wxyz * sign[:, None])
