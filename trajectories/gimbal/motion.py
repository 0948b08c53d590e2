"""Motion of a gimbal's joints along the flight of the vehicle that carries it."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.camera_mount import Motion
from uavbench.trajectories.gimbal.axes import GimbalAxis, Joints
from uavbench.trajectories.gimbal.servo import Servo
from uavbench.trajectories.pose import Array, Pose


class Pointed(Protocol):
    """A gimbal with its task."""

    @property
    def axes_of_joints(self) -> tuple[GimbalAxis, ...]:
        """Dynamics and limits of yaw, roll and pitch joint."""
        ...

    def commands(self, world_from_body: Pose, target_m: Array) -> Joints:
        """Angles that the joints are commanded to on a body at a pose."""
        ...

    def cam_from_body(self, yaw_rad: float, roll_rad: float, pitch_rad: float) -> Pose:
        """Pose of the camera on the body for angles of the joints."""
        ...


class GimbalMotion:
    """The joints of a gimbal along a motion; called with a time (ns), `cam_from_body` then.

    One step of the servos per row; each takes as exact the attitude of the body. Between rows the angles are linear in
    time. At the first row the gimbal is at rest. Rows are simulated as far as they are flown and asked
    for: in flight, in lockstep with the motion.
    """

    def __init__(self, gimbal: Pointed, motion: Motion, target_m: Array) -> None:
        self._gimbal, self._motion, self._target_m = gimbal, motion, np.asarray(target_m, dtype=np.float64)
        self._stamps = motion.stamps_ns
        self._rows: list[Joints] = []
        self._servos: tuple[Servo, ...] = ()

    def __call__(self, stamp_ns: int) -> Pose:
        """`cam_from_body` at a time (ns)."""
        return self._gimbal.cam_from_body(*self.angles(np.array([stamp_ns]))[0])

    def at_rest_on(self, world_from_body: Pose) -> Joints:
        """Angles at which the joints come to rest on a body that rests at a pose: the commands, within the stops."""
        commands = self._gimbal.commands(world_from_body, self._target_m)
        return Joints(*(servo.angle for servo in self._servos_at(commands)))

    def angles(self, stamps_ns: NDArray[np.int64]) -> Array:
        """True angles (n, 3) of yaw, roll and pitch joint at times, rad; held beyond the first and last row."""
        latest_ns = int(np.max(stamps_ns, initial=int(self._stamps[0])))
        rows = min(int(self._stamps.searchsorted(latest_ns)) + 1, len(self._motion))
        self._simulate(rows)
        last = max(rows - 2, 0)
        row = np.clip(np.searchsorted(self._stamps[:rows], stamps_ns, side="right") - 1, 0, last)
        after = np.minimum(row + 1, rows - 1)
        step = np.maximum(self._stamps[after] - self._stamps[row], 1)
        share = np.clip((stamps_ns - self._stamps[row]) / step, 0.0, 1.0)[:, None]
        here, there = (np.array([self._rows[k] for k in which]).reshape(-1, 3) for which in (row, after))
        return np.asarray(np.where(share == 1.0, there, (1 - share) * here + share * there))

    def beyond_stops_rad(self, stamps_ns: NDArray[np.int64]) -> Array:
        """How far (n, 3), rad, the joints are commanded beyond their stops in the rows at or before times (n,)."""
        self.angles(stamps_ns)
        return np.array([self._beyond(row) for row in self._rows_before(stamps_ns)]).reshape(-1, 3)

    def to_target_m(self, stamps_ns: NDArray[np.int64]) -> Array:
        """Distances (n,) in metres from the camera's centre to the target in the rows at or before times (n,)."""
        centre = self._gimbal.cam_from_body(0.0, 0.0, 0.0).inverse().translation
        places = [self._motion.pose(row).transform(centre[None])[0] for row in self._rows_before(stamps_ns)]
        return np.asarray(np.linalg.norm(np.array(places).reshape(-1, 3) - self._target_m, axis=1))

    def _rows_before(self, stamps_ns: NDArray[np.int64]) -> list[int]:
        rows: list[int] = np.clip(np.searchsorted(self._stamps, stamps_ns, side="right") - 1, 0, None).tolist()
        return rows

    def _beyond(self, row: int) -> list[float]:
        """How far each joint is commanded beyond its stops in a row, by the turn nearest to its angle."""
        out = []
        commands = self._gimbal.commands(self._motion.pose(row), self._target_m)
        for axis, angle, command in zip(self._gimbal.axes_of_joints, self._rows[row], commands, strict=True):
            near = command + 2 * np.pi * round((angle - command) / (2 * np.pi))
            out.append(max(near - np.radians(axis.greatest_deg), np.radians(axis.least_deg) - near, 0.0))
        return out

    def _simulate(self, rows: int) -> None:
        """Advance the servos up to a number of rows."""
        while len(self._rows) < rows:
            commands = self._gimbal.commands(self._motion.pose(len(self._rows)), self._target_m)
            if not self._rows:
                self._servos = self._servos_at(commands)
                self._rows.append(Joints(*(servo.angle for servo in self._servos)))
            else:
                moved = (servo.advance(command) for servo, command in zip(self._servos, commands, strict=True))
                self._rows.append(Joints(*moved))

    def _servos_at(self, commands: Joints) -> tuple[Servo, ...]:
        """Servos at rest at their commands, in steps of the motion's rows."""
        step_s = int(self._stamps[1] - self._stamps[0]) / 1e9 if len(self._stamps) > 1 else 1.0
        axes = zip(self._gimbal.axes_of_joints, commands, strict=True)
        return tuple(Servo(axis, step_s, command) for axis, command in axes)
