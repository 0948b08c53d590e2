"""State estimators for guidance and control: the filter, the tracker's raw poses, or the ground truth as a bound."""

from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from uavbench.bench.closed_loop.sensing import Reading
from uavbench.bench.closed_loop.spec import CAMERA, FilterSpec
from uavbench.tracker.fusion.camera_on_body import KnownMount
from uavbench.tracker.fusion.events import Verdict
from uavbench.tracker.fusion.measurements import Height, Measurement, OpticalFlow, Position
from uavbench.tracker.fusion.state import Estimate, FusionConfig
from uavbench.tracker.fusion.vehicle_filter import VehicleFilter
from uavbench.tracker.protocol import Prediction, TrackResult
from uavbench.trajectories.pose import Array, Pose, rotation_exp
from uavbench.trajectories.sensors.barometer import EXPONENT, LAPSE_K_M, TEMPERATURE_K, Barometer
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck
from uavbench.trajectories.vehicle.quadrotor import physics

CLIMB_M_S = 0.5
"""Climb rate assumed for the change of range between two readings of a flow deck, m/s."""
ROUNDING_VARIANCE = 1.0 / 6.0
"""Variance of the difference of two rounded numbers, each off by a uniform error of one."""
KNOWN_STATES = 9
"""Position, velocity and attitude: the first states of the filter's error, for which ground truth exists."""
LEAST_BIAS_M_S2, LEAST_BIAS_RAD_S = 0.02, 0.002
"""Lower limits of the initial standard deviations of the IMU's biases, as after a calibration at rest."""


class Believed(NamedTuple):
    """A state in the form of MuJoCo: qpos (7,) position and quaternion wxyz, qvel (6,) velocity and body rates."""

    qpos: Array
    qvel: Array


class Start(NamedTuple):
    """Initial knowledge at time 0: pose of the camera, and velocity (3,) of the vehicle's plan in the world."""

    cam_from_world: Pose
    velocity_m_s: Array


class Estimator(Protocol):
    """Estimator of the vehicle's state from readings of its sensors and the tracker's results."""

    def sense(self, reading: Reading) -> None:
        """Process a reading of a body sensor."""
        ...

    def answer(self, stamp_ns: int, result: TrackResult) -> None:
        """Process the tracker's result for the frame with this stamp."""
        ...

    def state_at(self, stamp_ns: int) -> Believed | None:
        """Estimated state at a time in ns; None for the ground truth."""
        ...

    def covariance(self, stamp_ns: int) -> Array | None:
        """Covariance (9, 9) of position (m), velocity (m/s) and attitude (rad) at a time; None when none is claimed."""
        ...

    def expected(self, stamp_ns: int) -> Prediction | None:
        """Predicted pose of the camera at a time in ns; None for an estimator that only uses the tracker's poses."""
        ...

    @property
    def verdicts(self) -> list[Verdict]:
        """What became of each measurement."""
        ...


class TrueState:
    """The estimate is the ground truth; measurements are ignored."""

    verdicts: list[Verdict] = []  # noqa: RUF012

    def sense(self, reading: Reading) -> None:
        """Nothing."""

    def answer(self, stamp_ns: int, result: TrackResult) -> None:
        """Nothing."""

    def state_at(self, stamp_ns: int) -> None:
        """The true state."""

    def covariance(self, stamp_ns: int) -> None:
        """None: nothing is estimated."""

    def expected(self, stamp_ns: int) -> None:
        """None: the ground truth is not a prediction."""


class CameraAlone:
    """The latest pose, extrapolated by the velocity between the last two and by the gyroscope.

    Measurements are neither weighted nor gated nor smoothed; of the sensors only the named IMU is used. Late answers
    are ignored.
    """

    verdicts: list[Verdict] = []  # noqa: RUF012

    def __init__(self, imu: str, mount: KnownMount, start: Start) -> None:
        self._imu, self._mount = imu, mount
        self._to_quaternion = physics().mju_mat2Quat
        body = start.cam_from_world.inverse() @ mount.at(0).cam_from_body
        self._stamp_ns, self._place_m, self._velocity_m_s = 0, body.translation, start.velocity_m_s
        self._turned, self._turned_ns = body.rotation, 0
        self._rates = np.zeros(3)
        self._readings: list[Reading] = []

    def sense(self, reading: Reading) -> None:
        """Integrate a reading of the gyroscope."""
        if reading.name == self._imu:
            self._readings.append(reading)
            self._turn(reading)

    def answer(self, stamp_ns: int, result: TrackResult) -> None:
        """Adopt a pose unchanged."""
        if result.cam_from_world is None or stamp_ns < self._stamp_ns:
            return
        pose = result.cam_from_world.inverse() @ self._mount.at(stamp_ns).cam_from_body
        if stamp_ns > self._stamp_ns:
            self._velocity_m_s = (pose.translation - self._place_m) * (1e9 / (stamp_ns - self._stamp_ns))
        self._stamp_ns, self._place_m = stamp_ns, pose.translation
        self._turned, self._turned_ns = pose.rotation, stamp_ns
        self._readings = [reading for reading in self._readings if reading.stamp_ns > stamp_ns]
        for reading in self._readings:
            self._turn(reading)

    def state_at(self, stamp_ns: int) -> Believed:
        """State extrapolated with constant velocity and rates."""
        since_s = (stamp_ns - self._stamp_ns) * 1e-9
        quaternion = np.empty(4)
        self._to_quaternion(quaternion, self._after(stamp_ns).ravel())
        place_m = self._place_m + since_s * self._velocity_m_s
        return Believed(np.concatenate([place_m, quaternion]), np.concatenate([self._velocity_m_s, self._rates]))

    def covariance(self, stamp_ns: int) -> None:
        """None: no covariance is estimated."""

    def expected(self, stamp_ns: int) -> None:
        """None: there is no prediction independent of the tracker."""

    def _turn(self, reading: Reading) -> None:
        """Rotation from the previous reading to this one."""
        self._rates = reading.values[0:3]
        self._turned, self._turned_ns = self._after(reading.stamp_ns), reading.stamp_ns

    def _after(self, stamp_ns: int) -> Array:
        """Rotation (3, 3) at a time in ns, extrapolated from the latest reading by the latest rates."""
        return self._turned @ rotation_exp(self._rates * ((stamp_ns - self._turned_ns) * 1e-9))


class Filtered:
    """The vehicle's filter, with the sensors of the loop."""

    def __init__(self, spec: FilterSpec, sensors: tuple[str, ...], imu: Imu, mount: KnownMount, start: Start) -> None:
        self._spec, self._sensors = spec, sensors
        at_rest = Estimate.at_rest(
            0,
            start.cam_from_world.inverse() @ mount.at(0).cam_from_body,
            position_m=spec.start_m,
            attitude_rad=float(np.radians(spec.start_deg)),
            velocity_m_s=spec.start_m_s,
            accel_bias_m_s2=max(imu.accel_bias_m_s2, LEAST_BIAS_M_S2),
            gyro_bias_rad_s=max(imu.gyro_bias_rad_s, LEAST_BIAS_RAD_S),
        )
        self._to_quaternion = physics().mju_mat2Quat
        moving = replace(at_rest, velocity_m_s=start.velocity_m_s)
        self._filter = VehicleFilter(fusion_config(spec, imu), mount, moving)
        self._unclaimed = np.diag(np.repeat([spec.unclaimed_m, np.radians(spec.unclaimed_deg)], 3) ** 2)

    def sense(self, reading: Reading) -> None:
        """Pass a reading to the filter if its sensor is among those of the loop."""
        if reading.name not in self._sensors:
            return
        if isinstance(reading.sensor, Imu):
            self._filter.imu(reading.stamp_ns, reading.values[0:3], reading.values[3:6])
        elif (measurement := measurement_of(reading)) is not None:
            self._filter.take(measurement)

    def answer(self, stamp_ns: int, result: TrackResult) -> None:
        """Pass the tracker's pose to the filter; one without a covariance gets the assumed one."""
        if CAMERA not in self._sensors:
            return
        if result.status == "ok" and result.covariance is None:
            result = replace(result, covariance=self._unclaimed)
        self._filter.camera(stamp_ns, result)

    def state_at(self, stamp_ns: int) -> Believed:
        """The filter's state at a time."""
        state, rates = self._filter.nominal(stamp_ns)
        qpos, qvel = np.empty(7), np.empty(6)
        qpos[0:3], qvel[0:3], qvel[3:6] = state[0:3], state[3:6], rates
        self._to_quaternion(qpos[3:7], state[6:15])
        return Believed(qpos, qvel)

    def covariance(self, stamp_ns: int) -> Array:
        """The filter's covariance at a time in ns."""
        return self._filter.covariance(stamp_ns)[:KNOWN_STATES, :KNOWN_STATES]

    def expected(self, stamp_ns: int) -> Prediction | None:
        """The filter's prediction of the camera's pose; None where it is not finite."""
        pose, covariance = self._filter.predict_camera(stamp_ns)
        known = np.isfinite(pose.matrix).all() and np.isfinite(covariance).all()
        return Prediction(pose, covariance) if known else None

    @property
    def verdicts(self) -> list[Verdict]:
        """What became of each measurement."""
        return self._filter.verdicts


def fusion_config(spec: FilterSpec, imu: Imu) -> FusionConfig:
    """The filter's parameters, with noise densities from the IMU's data sheet."""
    return FusionConfig(
        accel_noise_m_s2_sqrt_hz=spec.imu_scale * imu.accel_noise_m_s2_sqrt_hz,
        gyro_noise_rad_s_sqrt_hz=spec.imu_scale * imu.gyro_noise_rad_s_sqrt_hz,
        accel_walk_m_s3_sqrt_hz=spec.imu_scale * imu.accel_walk_m_s3_sqrt_hz,
        gyro_walk_rad_s2_sqrt_hz=spec.imu_scale * imu.gyro_walk_rad_s2_sqrt_hz,
        camera_slow_share=spec.camera_slow_share,
        camera_slow_s=spec.camera_slow_s,
        camera_bias_m=spec.camera_bias_m,
        camera_bias_rad=float(np.radians(spec.camera_bias_deg)),
        gate=spec.gate,
        doubt_after=spec.doubt_after,
        history_s=spec.history_s,
    )


def measurement_of(reading: Reading) -> Measurement | None:
    """A reading as a measurement of the filter; None for an empty reading, and for unsupported sensors."""
    sensor, values = reading.sensor, reading.values
    if not np.isfinite(values).all():
        return None
    if isinstance(sensor, Gnss):
        return gnss_fix(sensor, reading.stamp_ns, values)
    if isinstance(sensor, Barometer):
        return pressure_height(sensor, reading.stamp_ns, values)
    if isinstance(sensor, FlowDeck):
        return flow(sensor, reading.stamp_ns, values)
    return None


def gnss_fix(sensor: Gnss, stamp_ns: int, values: Array) -> Position:
    """A position fix; its variances are those of the ranges times the dilution of precision, the same on all axes."""
    dilution = values[1] ** 2 / 3.0
    return Position(
        stamp_ns=stamp_ns,
        position_m=values[2:5],
        covariance=np.eye(3) * dilution * (sensor.slow_m**2 + sensor.white_m**2),
        velocity_m_s=values[5:8],
        velocity_covariance=np.eye(3) * dilution * sensor.doppler_m_s**2,
    )


def pressure_height(sensor: Barometer, stamp_ns: int, values: Array) -> Height:
    """A height measurement; 1 Pa corresponds to about 8 cm (standard atmosphere)."""
    metres_per_pa = TEMPERATURE_K / (LAPSE_K_M * EXPONENT * sensor.floor_pressure_pa)
    sigma_pa = float(np.hypot(sensor.noise_pa, sensor.drift_pa))
    return Height(stamp_ns=stamp_ns, height_m=float(values[1]), sigma_m=max(metres_per_pa * sigma_pa, 1e-3))


def flow(sensor: FlowDeck, stamp_ns: int, values: Array) -> OpticalFlow:
    """The mean flow since the last reading, stamped at the middle of the interval; the range may have changed."""
    dt_s = 1.0 / sensor.rate_hz
    px_per_rad_s = sensor.pixels / sensor.aperture_rad * dt_s
    sigma_px = float(np.sqrt(sensor.flow_noise_px**2 + ROUNDING_VARIANCE))
    return OpticalFlow(
        stamp_ns=stamp_ns - round(0.5e9 * dt_s),
        flow_rad_s=values[0:2] / px_per_rad_s,
        flow_sigma_rad_s=sigma_px / px_per_rad_s,
        range_m=float(values[2]),
        range_sigma_m=float(np.hypot(2.0 * sensor.range_noise_m, CLIMB_M_S * dt_s / 2)),
    )
