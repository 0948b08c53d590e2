"""The body's sensors in flight: each reading is simulated at its time, with noise from its own random stream."""

from bisect import bisect_right
from collections.abc import Callable
from copy import deepcopy
from dataclasses import fields
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.spec import LoopSpec
from uavbench.scenes.dataset.body import CALIBRATED, GIMBAL, Body, BodySensor, Samples
from uavbench.scenes.dataset.gimbal_files import gimbal_record
from uavbench.scenes.dataset.spec_record import described
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.fusion.camera_on_body import FixedMount, KnownMount, MeasuredGimbal
from uavbench.trajectories.camera_mount import MAIN
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.gimbal.encoders_in_flight import GimbalEncoders
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.registry import SENSORS, check_sensors, named
from uavbench.trajectories.sensors.sensor import (
    LiveSensorSpec,
    Reader,
    SensorSpec,
    Table,
    alike,
    stamps_between,
)
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

NEVER_NS = 2**63 - 1
"""A stamp in ns after the end of any flight."""


class Reading(NamedTuple):
    """Reading of one sensor at one time: its name, its spec, its values (k,) in the order and units of `measured`."""

    name: str
    sensor: SensorSpec
    stamp_ns: int
    values: Array


class LiveSensor:
    """One sensor in flight; next_ns: stamp of its next reading."""

    def __init__(
        self, name: str, sensor: LiveSensorSpec, steps: int, obstacles: ObstacleMesh, rng: np.random.Generator
    ) -> None:
        self.name, self.sensor = name, sensor
        self.stamps = stamps_between(0, (steps - 1) * STEP_NS, sensor.rate_hz)
        self.columns: tuple[str, ...] = tuple(getattr(sensor, "measured", ()))
        is_ours = type(sensor) in (*SENSORS.values(), GimbalEncoders)
        twin = None if is_ours else deepcopy(rng)
        self._reader: Reader = sensor.begin(len(self.stamps), obstacles, rng)
        self._twin: Reader | None = None if twin is None else sensor.begin(len(self.stamps), obstacles, twin)
        self._due_ns: list[int] = self.stamps.tolist()
        self._values = np.empty((len(self.stamps), len(self.columns)))
        self._given = self._done = self.next_ns = 0

    def read(self, record: Array, row: int) -> list[Reading]:
        """Readings that are due at a row of a flight's record."""
        if row * STEP_NS < self.next_ns:
            return []
        first, end = self._done, bisect_right(self._due_ns, row * STEP_NS, self._done)
        before = self._due_ns[max(first - 1, 0)] // STEP_NS
        values = self._values[first:end]
        flown, stamps = part(record, before, row), self.stamps[first:end]
        found = self._reader.read(flown, stamps)
        if self._twin is not None:
            self._check(found, self._twin.read(flown, stamps), stamps)
        values[:] = found[:, : len(self.columns)]
        self._done, self.next_ns = end, self._due_ns[end] if end < len(self._due_ns) else NEVER_NS
        return [Reading(self.name, self.sensor, self._due_ns[k], self._values[k]) for k in range(first, end)]

    def _check(self, found: Any, again: Any, stamps_ns: NDArray[np.int64]) -> None:
        """UserError for readings of a user's sensor in flight that are no table, or others when they are read again."""
        who = f"sensor {self.name}: at {int(stamps_ns[0]) / 1e9:.3f} s `read` of its reader gives"
        shape = (len(stamps_ns), len(self.columns))
        if not isinstance(found, np.ndarray) or found.ndim != 2 or len(found) != shape[0] or found.shape[1] < shape[1]:
            what = found.shape if isinstance(found, np.ndarray) else type(found).__name__
            raise UserError(f"{who} {what}; it takes numbers {shape}, a row a stamp, the columns of `measured` first")
        if np.isinf(found[:, : shape[1]]).any():
            raise UserError(f"{who} infinite numbers; NaN where nothing was measured")
        if not alike(found, again):
            raise UserError(
                f"{who} other readings each time; take all random numbers from the `rng` of `begin`, and nothing from "
                "the clock or an earlier call"
            )

    def upto(self, stamp_ns: int) -> Samples:
        """Readings up to and including a stamp, without those returned before."""
        first, self._given = self._given, bisect_right(self._due_ns, stamp_ns, self._given, self._done)
        return Samples(self.stamps[first : self._given].copy(), self._values[first : self._given].copy())

    def table(self) -> Table:
        """All readings so far."""
        return Table(self.columns, self.stamps[: self._done], self._values[: self._done])


class Sensors:
    """All sensors of a sequence in flight, and the readings handed to the tracker.

    true_mount: `cam_from_body` at a time (ns), of which the encoders of a gimbal measure the angles; mount: what the
    vehicle knows of it.
    """

    def __init__(
        self,
        spec: SequenceSpec,
        loop: LoopSpec,
        steps: int,
        obstacles: ObstacleMesh,
        true_mount: Callable[[int], Pose],
    ) -> None:
        seed = spec.seed
        check_sensors(tuple(live(sensor) for sensor in spec.sensors), (steps - 1) * STEP_NS)
        self._live = [
            LiveSensor(name, live(sensor), steps, obstacles, stream(seed, "sensor", name))
            for name, sensor in named(spec.sensors).items()
        ]
        self.mount: KnownMount = FixedMount(spec.mount.at_rest.cam_from_body)
        if isinstance(spec.mount, Gimbal) and isinstance(true_mount, GimbalMotion):
            self.mount = MeasuredGimbal(spec.mount)
            encoders = GimbalEncoders(spec.mount, true_mount)
            self._live.append(LiveSensor(GIMBAL, encoders, steps, obstacles, stream(seed, "gimbal", MAIN)))
        self._outages_ns = [(a * 1e9, b * 1e9) for a, b in loop.gnss_outages_s]
        self.has_fix = False
        self._next_ns = 0
        self.body = body_of(spec)

    def read(self, record: Array, row: int) -> list[Reading]:
        """Readings that are due, in the order of the sensors."""
        if row * STEP_NS < self._next_ns:
            return []
        new = [reading for sensor in self._live for reading in sensor.read(record, row)]
        for reading in new:
            if isinstance(reading.sensor, Gnss):
                self._receive(reading)
            elif isinstance(self.mount, MeasuredGimbal) and reading.name == GIMBAL:
                self.mount.read(reading.stamp_ns, reading.values)
        self._next_ns = min((sensor.next_ns for sensor in self._live), default=NEVER_NS)
        return new

    def upto(self, stamp_ns: int) -> dict[str, Samples]:
        """Readings by sensor up to and including a stamp, without those returned before."""
        return {sensor.name: sensor.upto(stamp_ns) for sensor in self._live}

    def tables(self) -> dict[str, Table]:
        """All readings so far, by sensor, as the vehicle had them."""
        return {sensor.name: sensor.table() for sensor in self._live}

    def _receive(self, fix: Reading) -> None:
        """Note whether there is a fix; during an outage there is none."""
        if any(first <= fix.stamp_ns < last for first, last in self._outages_ns):
            fix.values[0], fix.values[1:] = 0.0, np.nan
        self.has_fix = bool(np.isfinite(fix.values).all())


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
    if not isinstance(spec.mount, Gimbal):
        return Body(spec.mount.at_rest.cam_from_body, MappingProxyType(sensors))
    gimbal, about = spec.mount, gimbal_record(spec.mount, MAIN)
    parameters = {key: about[key] for key in sorted(CALIBRATED & set(about))}
    sensors[GIMBAL] = BodySensor(GIMBAL, tuple(about["measured"]), MappingProxyType(parameters))
    geometry = Gimbal(axes=gimbal.axes, yaw_deg=gimbal.yaw_deg, offset_m=gimbal.offset_m)
    return Body(None, MappingProxyType(sensors), geometry)


def part(record: Array, first: int, last: int) -> Flight:
    """Rows `first` to `last` of a flight's record."""
    return Flight.of_rows(np.arange(first, last + 1, dtype=np.int64) * STEP_NS, record[first : last + 1])
