"""The body's sensors in flight: each reading is simulated at its time, with noise from its own random stream."""

from bisect import bisect_right
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from uavbench.bench.closed_loop.spec import LoopSpec
from uavbench.scenes.dataset.body import CALIBRATED, Body, BodySensor, Samples
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.registry import named
from uavbench.trajectories.sensors.sensor import LiveSensorSpec, Reader, SensorSpec, Table, stamps_between
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

NEVER_NS = 2**63 - 1
"""A stamp in ns after the end of any flight."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Reading of one sensor at one time: its name, its spec, its values (k,) in the order and units of `measured`."""

    name: str
    sensor: SensorSpec
    stamp_ns: int
    values: Array


class LiveSensor:
    """One sensor in flight; next_ns: stamp of its next reading."""

    def __init__(self, name: str, sensor: LiveSensorSpec, steps: int, obstacles: ObstacleMesh, seed: int) -> None:
        self.name, self.sensor = name, sensor
        self.stamps = stamps_between(0, (steps - 1) * STEP_NS, sensor.rate_hz)
        self.columns: tuple[str, ...] = tuple(getattr(type(sensor), "measured", ()))
        self._reader: Reader = sensor.begin(len(self.stamps), obstacles, stream(seed, "sensor", name))
        self._due_ns: list[int] = self.stamps.tolist()
        self._done, self.next_ns = 0, 0

    def read(self, record: Array, row: int) -> list[Reading]:
        """Readings that are due at a row of a flight's record."""
        if row * STEP_NS < self.next_ns:
            return []
        end = bisect_right(self._due_ns, row * STEP_NS, self._done)
        before = self._due_ns[max(self._done - 1, 0)] // STEP_NS
        new = self.stamps[self._done : end]
        values = self._reader.read(part(record, before, row), new)[:, : len(self.columns)]
        self._done, self.next_ns = end, self._due_ns[end] if end < len(self._due_ns) else NEVER_NS
        return [Reading(self.name, self.sensor, t, v) for t, v in zip(new.tolist(), values, strict=True)]

    def samples(self, readings: list[Reading]) -> Samples:
        """Readings of this sensor as arrays."""
        stamps = np.array([reading.stamp_ns for reading in readings], dtype=np.int64)
        values = np.array([reading.values for reading in readings]).reshape(len(readings), len(self.columns))
        return Samples(stamps, values)


class Sensors:
    """All sensors of a sequence in flight, and the readings handed to the tracker."""

    def __init__(self, spec: SequenceSpec, loop: LoopSpec, steps: int, obstacles: ObstacleMesh) -> None:
        self._live = [LiveSensor(n, live(s), steps, obstacles, spec.seed) for n, s in named(spec.sensors).items()]
        self._outages_ns = [(a * 1e9, b * 1e9) for a, b in loop.gnss_outages_s]
        self._kept: dict[str, list[Reading]] = {sensor.name: [] for sensor in self._live}
        self._all: dict[str, list[Reading]] = {sensor.name: [] for sensor in self._live}
        self.has_fix = False
        self._next_ns = 0
        self.body = body_of(spec)

    def read(self, record: Array, row: int) -> list[Reading]:
        """Readings that are due, in the order of the sensors."""
        if row * STEP_NS < self._next_ns:
            return []
        new = [self._seen(reading) for sensor in self._live for reading in sensor.read(record, row)]
        for reading in new:
            self._kept[reading.name].append(reading)
            self._all[reading.name].append(reading)
        self._next_ns = min((sensor.next_ns for sensor in self._live), default=NEVER_NS)
        return new

    def upto(self, stamp_ns: int) -> dict[str, Samples]:
        """Readings by sensor up to and including a stamp, without those returned before."""
        out = {}
        for sensor in self._live:
            kept = self._kept[sensor.name]
            count = sum(reading.stamp_ns <= stamp_ns for reading in kept)
            out[sensor.name] = sensor.samples(kept[:count])
            del kept[:count]
        return out

    def tables(self) -> dict[str, Table]:
        """All readings so far, by sensor, as the vehicle had them."""
        samples = {sensor: sensor.samples(self._all[sensor.name]) for sensor in self._live}
        return {sensor.name: Table(sensor.columns, of.stamps_ns, of.values) for sensor, of in samples.items()}

    def _seen(self, reading: Reading) -> Reading:
        """The reading, without a fix during a GNSS outage."""
        if not isinstance(reading.sensor, Gnss):
            return reading
        values = reading.values
        if any(first <= reading.stamp_ns < last for first, last in self._outages_ns):
            values = np.concatenate([[0.0], np.full(len(values) - 1, np.nan)])
        self.has_fix = bool(np.isfinite(values).all())
        return Reading(reading.name, reading.sensor, reading.stamp_ns, values)


def live(sensor: SensorSpec) -> Any:
    """A sensor that can be simulated in flight; UserError for one that cannot."""
    if not (callable(getattr(sensor, "begin", None)) and hasattr(sensor, "rate_hz")):
        raise UserError(
            f"sensors: {type(sensor).__name__} cannot be read in flight: it needs `rate_hz` and `begin` "
            "(trajectories/sensors/sensor.py, LiveSensorSpec); leave it out of a suite that is flown"
        )
    return sensor


def body_of(spec: SequenceSpec) -> Body:
    """Description of the body that carries the camera, as given to trackers."""
    sensors = {}
    for name, sensor in named(spec.sensors).items():
        about = described(sensor)
        kind = str(about.get("kind", type(sensor).__name__))
        known = {f.name for f in fields(sensor) if f.init} & CALIBRATED  # type: ignore[arg-type]
        parameters = {key: about[key] for key in sorted(known) if isinstance(about[key], int | float | list)}
        measured = tuple(getattr(type(sensor), "measured", ()))
        sensors[name] = BodySensor(kind, measured, MappingProxyType(parameters))
    return Body(spec.mount.at_rest.cam_from_body, MappingProxyType(sensors))


def part(record: Array, first: int, last: int) -> Flight:
    """Rows `first` to `last` of a flight's record."""
    return Flight.of_rows(np.arange(first, last + 1, dtype=np.int64) * STEP_NS, record[first : last + 1])
