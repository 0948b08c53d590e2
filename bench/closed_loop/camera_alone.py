"""Flying on the tracker's poses without a filter: what a filter is worth shows in the difference."""

import numpy as np

from uavbench.bench.closed_loop.estimators import Believed
from uavbench.bench.closed_loop.sensing import Reading
from uavbench.tracker.fusion.vehicle_filter import Verdict
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Array, Pose, rotation_exp
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.vehicle.quadrotor import physics


class CameraAlone:
    """The latest pose, carried on by the velocity between the last two and turned by the gyroscope's readings.

    No reading is weighed, refused or smoothed, and no other sensor is taken; what is out of order is left out.
    """

    verdicts: list[Verdict] = []  # noqa: RUF012

    def __init__(self, cam_from_body: Pose, first_cam_from_world: Pose) -> None:
        self._cam_from_body = cam_from_body
        self._to_quaternion = physics().mju_mat2Quat
        start = first_cam_from_world.inverse() @ cam_from_body
        self._stamp_ns, self._place_m, self._velocity_m_s = 0, start.translation, np.zeros(3)
        self._turned, self._turned_ns = start.rotation, 0
        self._rates = np.zeros(3)
        self._readings: list[Reading] = []

    def sense(self, reading: Reading) -> None:
        """Turn by a reading of the gyroscope."""
        if isinstance(reading.sensor, Imu):
            self._readings.append(reading)
            self._turn(reading)

    def answer(self, stamp_ns: int, result: TrackResult) -> None:
        """Take a pose as it is."""
        if result.cam_from_world is None or stamp_ns < self._stamp_ns:
            return
        pose = result.cam_from_world.inverse() @ self._cam_from_body
        if stamp_ns > self._stamp_ns:
            self._velocity_m_s = (pose.translation - self._place_m) * (1e9 / (stamp_ns - self._stamp_ns))
        self._stamp_ns, self._place_m = stamp_ns, pose.translation
        self._turned, self._turned_ns = pose.rotation, stamp_ns
        self._readings = [reading for reading in self._readings if reading.stamp_ns > stamp_ns]
        for reading in self._readings:
            self._turn(reading)

    def state_at(self, stamp_ns: int) -> Believed:
        """Where the vehicle is if it kept its velocity and its rates."""
        since_s = (stamp_ns - self._stamp_ns) * 1e-9
        quaternion = np.empty(4)
        self._to_quaternion(quaternion, self._after(stamp_ns).ravel())
        place_m = self._place_m + since_s * self._velocity_m_s
        return Believed(np.concatenate([place_m, quaternion]), np.concatenate([self._velocity_m_s, self._rates]))

    def covariance(self, stamp_ns: int) -> None:
        """None: nothing is known of its errors."""

    def expected(self, stamp_ns: int) -> None:
        """None: all that is known are the tracker's own poses."""

    def _turn(self, reading: Reading) -> None:
        """Turn from the reading before to this one."""
        self._rates = reading.values[0:3]
        self._turned, self._turned_ns = self._after(reading.stamp_ns), reading.stamp_ns

    def _after(self, stamp_ns: int) -> Array:
        """Rotation (3, 3) at a time, turned at the latest rates since the latest reading."""
        return self._turned @ rotation_exp(self._rates * ((stamp_ns - self._turned_ns) * 1e-9))
