"""Inertial measurement units with the noise model of Kalibr and EuRoC."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from uavbench.trajectories.camera_mount import check_offset
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.geometry.vectors import Vector, add, cross, rotate, rotation, subtract, transpose, vector
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.sensor import Reader, RowByRow, Table, sample_stamps
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh

MOST = {
    "gyro_noise_rad_s_sqrt_hz": 1.0,
    "gyro_walk_rad_s2_sqrt_hz": 1.0,
    "accel_noise_m_s2_sqrt_hz": 10.0,
    "accel_walk_m_s3_sqrt_hz": 10.0,
    "gyro_bias_rad_s": 1.0,
    "accel_bias_m_s2": 10.0,
    "gyro_range_rad_s": 200.0,
    "accel_range_m_s2": 1e4,
}
"""Largest values of parameters, in the units of their names, far above those of units in use.

Consumer units have noise of 2e-4 rad/s/sqrt(Hz) and 3e-3 m/s^2/sqrt(Hz) (data sheets of BMI088 and ADIS16448), and
ranges to 4000 deg/s (70 rad/s) and 400 g (ICM-20649, H3LIS331DL). Most values in micro-g, mg or deg/h are beyond.
"""


@dataclass(frozen=True)
class Imu:
    """Gyroscope and accelerometer with white noise and bias random walk; the defaults are EuRoC's ADIS16448.

    Noise densities and random walks are those of Kalibr's model: at a step dt the noise has the standard deviation
    density / sqrt(dt), and the bias steps by walk * sqrt(dt). Initial biases are random with the given standard
    deviations. The unit is at offset_m on the body, aligned with its axes. Readings saturate at the ranges.
    ValueError for values beyond MOST, and an offset beyond that of any vehicle.
    """

    measured: ClassVar[tuple[str, ...]] = ("wx_rad_s", "wy_rad_s", "wz_rad_s", "ax_m_s2", "ay_m_s2", "az_m_s2")

    rate_hz: Annotated[float, Gt(0)] = 200.0
    gyro_noise_rad_s_sqrt_hz: Annotated[float, Ge(0)] = 1.6968e-4
    gyro_walk_rad_s2_sqrt_hz: Annotated[float, Ge(0)] = 1.9393e-5
    accel_noise_m_s2_sqrt_hz: Annotated[float, Ge(0)] = 2.0e-3
    accel_walk_m_s3_sqrt_hz: Annotated[float, Ge(0)] = 3.0e-3
    gyro_bias_rad_s: Annotated[float, Ge(0)] = 0.0
    accel_bias_m_s2: Annotated[float, Ge(0)] = 0.0
    gyro_range_rad_s: Annotated[float, Gt(0)] = 17.45
    accel_range_m_s2: Annotated[float, Gt(0)] = 176.0
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_offset(self.offset_m)
        for name, most in MOST.items():
            if getattr(self, name) > most:
                raise ValueError(
                    f"{name} {getattr(self, name):g} is more than {most:g}, which no unit has; give it in the unit of "
                    "its name (1 deg/s is 0.01745 rad/s, 1 micro-g is 9.807e-6 m/s^2)"
                )

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Angular rates and specific forces in the body, and the biases that they contain."""
        stamps = sample_stamps(flight, self.rate_hz)
        columns = [f"{name}{axis}_{unit}" for name, unit in _NAMES for axis in "xyz"]
        return Table(tuple(columns), stamps, self._readings(flight, stamps, self._noise(len(stamps), rng)))

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Reader:
        """Reader of the unit in flight."""
        return RowByRow(self._noise(readings, rng), self._readings)

    def _noise(self, n: int, rng: np.random.Generator) -> Array:
        """White noise and biases (n, 12) of the readings: of the gyroscope and the accelerometer each."""
        dt = 1.0 / self.rate_hz
        gyro_rng, accel_rng, *bias_rngs = rng.spawn(4)  # a longer flight starts with the same noise
        biases = [
            start * bias_rng.standard_normal(3)
            + walk * np.sqrt(dt) * np.cumsum(bias_rng.standard_normal((n, 3)), axis=0)
            for start, walk, bias_rng in (
                (self.gyro_bias_rad_s, self.gyro_walk_rad_s2_sqrt_hz, bias_rngs[0]),
                (self.accel_bias_m_s2, self.accel_walk_m_s3_sqrt_hz, bias_rngs[1]),
            )
        ]
        gyro = self.gyro_noise_rad_s_sqrt_hz / np.sqrt(dt) * gyro_rng.standard_normal((n, 3))
        accel = self.accel_noise_m_s2_sqrt_hz / np.sqrt(dt) * accel_rng.standard_normal((n, 3))
        return np.column_stack([gyro, accel, *biases])

    def _readings(self, flight: Flight, stamps_ns: NDArray[np.int64], noise: Array) -> Array:
        out = np.empty((len(stamps_ns), 12))
        ranges = float(self.gyro_range_rad_s), float(self.accel_range_m_s2)
        _fill_readings(flight.stamps_ns, _ideal(flight, self.offset_m), stamps_ns, noise, ranges, out)
        return out


_NAMES = (("w", "rad_s"), ("a", "m_s2"), ("gyro_bias_", "rad_s"), ("accel_bias_", "m_s2"))


@dataclass(frozen=True)
class ImuBmi088(Imu):
    """The Crazyflie 2.1's Bosch BMI088 by its data sheet (rev. 1.4): 0.014 deg/s/sqrt(Hz) and 175 micro-g/sqrt(Hz).

    Ranges are those the firmware sets, 2000 deg/s and 24 g. The data sheet gives no random walk; EuRoC's are kept.
    """

    gyro_noise_rad_s_sqrt_hz: Annotated[float, Ge(0)] = 2.443e-4
    accel_noise_m_s2_sqrt_hz: Annotated[float, Ge(0)] = 1.716e-3
    gyro_range_rad_s: Annotated[float, Gt(0)] = 34.9
    accel_range_m_s2: Annotated[float, Gt(0)] = 235.0


class InertialGroundTruth(NamedTuple):
    """Angular velocities (n, 3) in rad/s and specific forces (n, 3) in m/s^2, in the body's axes."""

    rates_rad_s: Array
    forces_m_s2: Array


def inertial_ground_truth(flight: Flight, offset_m: Array) -> InertialGroundTruth:
    """Measurements of an ideal IMU at offset_m (3,) on the body at each row of a flight.

    f = R' (a - g) + alpha x r + omega x (omega x r).
    """
    x, y, z = offset_m.tolist()
    both = _ideal(flight, (x, y, z))
    return InertialGroundTruth(both[:, 0:3], both[:, 3:6])


def _ideal(flight: Flight, offset_m: Vector) -> Array:
    """Body rates and specific forces (n, 6) of `inertial_ground_truth`."""
    x_m, y_m, z_m = offset_m
    out = np.empty((len(flight), 6))
    _fill_ideal(
        flight.quaternions_wxyz,
        flight.angular_velocities_rad_s,
        flight.angular_accelerations_rad_s2,
        flight.accelerations_m_s2,
        (float(x_m), float(y_m), float(z_m)),
        out,
    )
    return out


@compiled("f2~ f2~ f2~ f2~ (f0 f0 f0) f2!")
def _fill_ideal(quaternions: Array, omegas: Array, alphas: Array, accelerations: Array, r: Vector, out: Array) -> None:
    """Fill `_ideal` row by row: the few rows of a reading in flight cost no more than their arithmetic."""
    is_off = r[0] != 0.0 or r[1] != 0.0 or r[2] != 0.0
    for n in range(len(out)):
        q, omega = quaternions[n], vector(omegas[n])
        norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        axes = transpose(rotation(q / norm))
        force = rotate(axes, subtract(vector(accelerations[n]), (0.0, 0.0, -GRAVITY_M_S2)))
        if is_off:
            force = add(add(force, cross(vector(alphas[n]), r)), cross(omega, cross(omega, r)))
        for k in range(3):
            out[n, k], out[n, 3 + k] = omega[k], force[k]


@compiled("i1 f2 i1 f2 (f0 f0) f2!")
def _fill_readings(
    flown_ns: NDArray[np.int64],
    ideal: Array,
    stamps_ns: NDArray[np.int64],
    noise: Array,
    ranges: tuple[float, float],
    out: Array,
) -> None:
    """Fill readings (n, 12) from ideal ones (m, 6) at the stamps (m,) of a flight, sampled as by `sampled`."""
    last = len(flown_ns) - 1
    for n in range(len(stamps_ns)):
        row = min(max(np.searchsorted(flown_ns, stamps_ns[n], side="right") - 1, 0), max(last - 1, 0))
        after = min(row + 1, last)
        share = (stamps_ns[n] - flown_ns[row]) / max(flown_ns[after] - flown_ns[row], 1)
        for k in range(6):
            value = ideal[row, k]
            if share == 1.0:
                value = ideal[after, k]
            elif share != 0.0:
                value = (1.0 - share) * ideal[row, k] + share * ideal[after, k]
            limit = ranges[k // 3]
            out[n, k] = np.minimum(np.maximum(value + noise[n, 6 + k] + noise[n, k], -limit), limit)
            out[n, 6 + k] = noise[n, 6 + k]
