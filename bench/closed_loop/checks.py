"""Checks of a loop before its start: whether its sensors make position and velocity observable."""

from collections.abc import Collection

from uavbench.bench.closed_loop.latency import Constant, Lognormal
from uavbench.bench.closed_loop.spec import CAMERA, LoopSpec
from uavbench.scenes.dataset.body import GIMBAL
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.sensors.barometer import Barometer
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.sensors.registry import named
from uavbench.trajectories.sensors.sensor import SensorSpec

FUSED = (Imu, Gnss, Barometer, FlowDeck)
"""Sensors that the vehicle uses (`estimators.measurement_of`); trackers are given the readings of all."""
ENDLESS_S = 1e9
"""Longer than any flight, s: 32 years."""


def check_loop(loop: LoopSpec, spec: SequenceSpec, flight_s: float = ENDLESS_S) -> tuple[str, ...]:
    """Names of the sequence's sensors that the filter uses; UserError when position or velocity is unobservable.

    UserError, too, for a sensor that the loop names and the vehicle has no use of. flight_s: duration of the
    flight, once it is known, which `time_limit_s` may end earlier; GNSS that is denied for as long holds nothing,
    and an outage that begins later denies none.
    """
    flight_s = min(flight_s, loop.time_limit_s or ENDLESS_S)
    for first, last in loop.gnss_outages_s:
        if first >= flight_s:
            raise UserError(
                f"sequence {spec.name}: gnss_outages_s: [{first:g}, {last:g}] begins after the end of the flight, "
                f"which takes {flight_s:.4g} s; give it in seconds since the start, or leave it out"
            )
    there = named(spec.sensors)
    wanted = (CAMERA, *there) if loop.sensors is None else loop.sensors
    for name in wanted:
        if name != CAMERA and name not in there:
            raise unknown_name(f"sensor of sequence {spec.name}", name, [CAMERA, *there])
        if name != CAMERA and loop.sensors is not None and not isinstance(there[name], FUSED):
            raise UserError(
                f"sequence {spec.name}: loop.sensors: the vehicle has no use of `{name}`, but only of the camera, IMU, "
                "GNSS, barometer and flow deck: leave it out; trackers are given its readings all the same"
            )
    if isinstance(spec.flight.path, Recorded):
        raise UserError(f"sequence {spec.name}: a recorded motion cannot be flown; choose a path that is planned")
    if spec.cameras or spec.clock != CameraClock():
        raise UserError(
            f"sequence {spec.name}: in closed loop only the main camera is simulated, without jitter or time shift: "
            "leave out `cameras` and `clock`"
        )
    _check_mount(spec, there, flight_s)
    sensors = {name: there[name] for name in wanted if name != CAMERA}
    if loop.estimator != "truth":
        _check_imu(spec.name, sensors)
    if loop.estimator == "filter":
        _check_filter(loop, spec.name, sensors, CAMERA in wanted, flight_s)
    if loop.estimator == "camera" and CAMERA not in wanted:
        raise UserError(
            f"sequence {spec.name}: estimator `camera` uses the tracker's poses: add `camera` to `loop.sensors`"
        )
    return tuple(wanted)


def loop_imu(sensors: Collection[str], spec: SequenceSpec) -> str:
    """Name of the only IMU among the sensors of a loop that uses an estimator; UserError unless there is exactly one.

    sensors: as `check_loop` returns them.
    """
    return next(name for name, sensor in named(spec.sensors).items() if name in sensors and isinstance(sensor, Imu))


def _check_mount(spec: SequenceSpec, sensors: Collection[str], flight_s: float) -> None:
    """UserError for a mount that the vehicle cannot know, by its angles or by the readings of its encoders."""
    if isinstance(spec.mount, Mount):
        return
    if not isinstance(spec.mount, Gimbal):
        raise UserError(
            f"sequence {spec.name}: in closed loop the camera's mount is fixed or a gimbal, not "
            f"{type(spec.mount).__name__}, whose pose on the body the vehicle does not know; render the sequence"
        )
    if GIMBAL in sensors:
        raise UserError(f"sequence {spec.name}: a sensor has the name {GIMBAL} of the encoders; rename its class")
    try:
        spec.mount.encoder.check(round(1e9 * flight_s))
    except UserError as error:
        raise UserError(f"sequence {spec.name}: gimbal: {error}") from None


def _check_imu(sequence: str, sensors: dict[str, SensorSpec]) -> None:
    imus = [sensor for sensor in sensors.values() if isinstance(sensor, Imu)]
    if len(imus) != 1:
        raise UserError(
            f"sequence {sequence}: the vehicle takes one IMU, and there are {len(imus)}: name it in the sequence's "
            "`sensors` and in `loop.sensors`"
        )
    if any(imus[0].offset_m):
        raise UserError(f"sequence {sequence}: the vehicle takes an IMU in the body's origin: leave out its offset_m")


def _check_filter(loop: LoopSpec, sequence: str, sensors: dict[str, SensorSpec], camera: bool, flight_s: float) -> None:
    gnss = any(isinstance(sensor, Gnss) for sensor in sensors.values())
    denied = gnss and _covered(loop.gnss_outages_s, flight_s)
    flow = any(isinstance(sensor, FlowDeck) for sensor in sensors.values())
    if not (camera or flow or (gnss and not denied)):
        without = ", without GNSS during the whole flight (loop.gnss_outages_s)," if denied else ""
        raise UserError(
            f"sequence {sequence}: no sensor can hold the vehicle: {', '.join(sensors)} alone{without} leave its place "
            f"to drift within seconds; add `camera`{'' if denied else ', `gnss`'} or `flow` to `loop.sensors`"
        )
    latency_ms = {Constant: "ms", Lognormal: "median_ms"}.get(type(loop.latency))
    if latency_ms and getattr(loop.latency, latency_ms) >= 1e3 * loop.filter.history_s:
        raise UserError(
            f"loop.latency.{latency_ms}: every answer would come after filter.history_s = {loop.filter.history_s:g} s "
            "and count for nothing; raise history_s"
        )


def _covered(intervals_s: tuple[tuple[float, float], ...], until_s: float) -> bool:
    """Whether intervals in s leave no gap from 0 to a time."""
    reached_s = 0.0
    for first, last in sorted(intervals_s):
        if first > reached_s:
            return False
        reached_s = max(reached_s, last)
    return reached_s >= until_s
