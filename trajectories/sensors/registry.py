"""Registry of body sensors by name, and the files of a flight: its record and the sensors' measurements."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.limits import MOST_ROWS
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu, ImuBmi088
from uavbench.trajectories.sensors.lidar import Lidar2d, Lidar3d
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.range_finder import RangeFinder
from uavbench.trajectories.sensors.ranging import LaserRanging
from uavbench.trajectories.sensors.sensor import (
    SensorSpec,
    Table,
    check_rate,
    check_same,
    check_table,
    stamps_between,
    write_records,
    write_table,
)

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh

FLIGHT_RATE_HZ = 100.0
"""Rate of flight.csv: every fifth row of the record."""
NAME = re.compile(r"[A-Za-z0-9_-]{1,80}")
"""Name of a sensor, which is that of its file."""
SEQUENCE_FILES = frozenset({"flight", "groundtruth", "frames", "crlb", "edges", "estimates", "row_poses", "mounts"})
"""Names of files of a sequence other than readings."""
TAKEN = SEQUENCE_FILES | {
    *("row_mounts", "gimbal", "camera"),
    *("path", "plan", "plan_mounts", "answers", "innovations", "times"),  # of a flight in closed loop
}
"""Names that no sensor can have: those of other files, and what stands for the camera and its mount."""


def flight_table(flight: Flight) -> Table:
    """Ground truth of a flight at FLIGHT_RATE_HZ, rows of its record: motion, motors and wind."""
    first, last = int(flight.stamps_ns[0]), int(flight.stamps_ns[-1])
    rows = np.flatnonzero(np.isin(flight.stamps_ns, stamps_between(first, last, FLIGHT_RATE_HZ)))
    groups = (
        ("p", "m", "xyz", flight.positions_m),
        ("q", "", "wxyz", flight.quaternions_wxyz),
        ("v", "m_s", "xyz", flight.velocities_m_s),
        ("a", "m_s2", "xyz", flight.accelerations_m_s2),
        ("w", "rad_s", "xyz", flight.angular_velocities_rad_s),
        ("alpha_", "rad_s2", "xyz", flight.angular_accelerations_rad_s2),
        ("thrust_command_", "n", "1234", flight.thrust_commands_n),
        ("thrust_", "n", "1234", flight.thrusts_n),
        ("wind_", "m_s", "xyz", flight.winds_m_s),
    )
    columns = [f"{name}{axis}_{unit}".rstrip("_") for name, unit, axes, _ in groups for axis in axes]
    return Table(tuple(columns), flight.stamps_ns[rows], np.column_stack([values[rows] for *_, values in groups]))


def measure(sensors: tuple[SensorSpec, ...], flight: Flight, obstacles: "ObstacleMesh", seed: int) -> dict[str, Table]:
    """Table of each sensor by its name on the body.

    Every sensor has a random stream of its own name, so adding one never changes another's readings. UserError naming
    the sensor that cannot measure on this flight.
    """
    check_sensors(sensors, int(flight.stamps_ns[-1] - flight.stamps_ns[0]))
    tables = {}
    for number, (name, sensor) in enumerate(named(sensors).items()):
        try:
            tables[name] = sensor.measure(flight, obstacles, stream(seed, "sensor", name))
            if type(sensor) not in SENSORS.values():
                check_table(tables[name], sensor, flight)
                check_same(tables[name], sensor.measure(flight, obstacles, stream(seed, "sensor", name)))
        except UserError as error:
            raise UserError(f"sensors[{number}], {name}: {error}") from None
    return tables


def check_sensors(sensors: tuple[SensorSpec, ...], flown_ns: int) -> None:
    """UserError naming the sensor of which a flight of a duration in ns has one reading, or more than a table may have.

    And of a user's sensor whose name is that of another file, or none of a file. It needs no memory for the readings. A
    sensor without `rate_hz` has its own rate.
    """
    for number, (name, sensor) in enumerate(named(sensors).items()):
        if name in TAKEN or not NAME.fullmatch(name):
            why = "is taken by another file or by the camera" if name in TAKEN else "takes letters, digits and _ only"
            raise UserError(
                f"sensors[{number}], {name}: its name, that of its class and of its file, {why}; rename the class"
            )
        if not hasattr(sensor, "rate_hz"):
            continue
        rate_hz = float(sensor.rate_hz)
        try:
            check_rate(rate_hz, flown_ns)
            if (rows := rate_hz * flown_ns / 1e9) > MOST_ROWS:
                raise UserError(
                    f"at rate_hz {rate_hz:g} it would have {rows:.3g} readings; a table has at most {MOST_ROWS:,}"
                )
        except UserError as error:
            raise UserError(f"sensors[{number}], {name}: {error}") from None


def check_places(sensors: tuple[SensorSpec, ...], flight: Flight, obstacles: "ObstacleMesh") -> None:
    """UserError naming the range finder or lidar that is inside the structure or under the floor on a flight."""
    for number, (name, sensor) in enumerate(named(sensors).items()):
        if isinstance(sensor, LaserRanging):
            try:
                sensor.check(flight, obstacles)
            except UserError as error:
                raise UserError(f"sensors[{number}], {name}: {error}") from None


def named(sensors: tuple[SensorSpec, ...]) -> dict[str, SensorSpec]:
    """Sensors by their names on the body: a second one of a kind is called `imu-2` and so on."""
    found: dict[str, SensorSpec] = {}
    for sensor in sensors:
        base = sensor_name(sensor)
        name = next(n for n in (base, *(f"{base}-{k}" for k in range(2, len(sensors) + 2))) if n not in found)
        found[name] = sensor
    return found


def write_flight(
    flight: Flight, sensors: tuple[SensorSpec, ...], obstacles: "ObstacleMesh", seed: int, folder: Path
) -> list[str]:
    """Write `flight.csv` and one file per sensor into a folder; returns the names of these files, `flight.csv` first.

    A `binary` sensor has NAME.npy for its measurements and NAME_truth.npy for the ground truth.
    """
    write_table(flight_table(flight), folder / "flight.csv")
    files = ["flight.csv"]
    tables = measure(sensors, flight, obstacles, seed)
    for (name, sensor), table in zip(named(sensors).items(), tables.values(), strict=True):
        if not getattr(type(sensor), "binary", False):
            write_table(table, folder / f"{name}.csv")
            files.append(f"{name}.csv")
            continue
        seen = tuple(column for column in table.columns if column in getattr(type(sensor), "measured", ()))
        write_records(table, seen, folder / f"{name}.npy")
        write_records(table, tuple(c for c in table.columns if c not in seen), folder / f"{name}_truth.npy")
        files.append(f"{name}.npy")
    return files


def sensor_name(sensor: SensorSpec) -> str:
    """Name of a sensor in SENSORS, else that of its class."""
    return next((name for name, kind in SENSORS.items() if type(sensor) is kind), type(sensor).__name__)


SENSORS: dict[str, type[SensorSpec]] = {
    "imu": Imu,
    "imu-bmi088": ImuBmi088,
    "flow": FlowDeck,
    "baro": Barometer,
    "gnss": Gnss,
    "range-finder": RangeFinder,
    "lidar-2d": Lidar2d,
    "lidar-3d": Lidar3d,
}

__all__ = ["FLIGHT_RATE_HZ", "SENSORS", "SensorSpec", "flight_table", "measure", "write_flight"]
