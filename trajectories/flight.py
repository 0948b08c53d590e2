"""A flight: what is flown, and the true record of it."""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval
from numpy.typing import NDArray

from trajectories.airframes import AirframeSpec, Crazyflie
from trajectories.control import Geometric
from trajectories.errors import UserError
from trajectories.flight_checks import check_camera, check_plan, check_saturation, crash_error, crash_step
from trajectories.hand_pilot import HandPilot
from trajectories.mount import Mount
from trajectories.paths import PATHS, PathSpec
from trajectories.pose import Array, Pose, read_only
from trajectories.quadrotor import STEP_NS, STEP_S, Quadrotor
from trajectories.reference import Planned, Replay
from trajectories.simulate import simulate
from trajectories.streams import stream
from trajectories.surroundings import Surroundings
from trajectories.trajectory import Trajectory
from trajectories.wind import Still, WindSpec

Status = Literal["completed", "crashed"]


@dataclass(frozen=True, eq=False)
class Flight:
    """The truth of one flight, one row per control step; arrays are read-only.

    stamps_ns (n,) int64 from step counts, 0 first; world_from_body as positions_m (n, 3) and quaternions_wxyz (n, 4);
    velocities_m_s and accelerations_m_s2 (n, 3) of the body's origin in the world (kinematic: 0 in hover);
    angular_velocities_rad_s and angular_accelerations_rad_s2 (n, 3) in the body; thrust_commands_n and thrusts_n
    (n, 4) of the four rotors; winds_m_s (n, 3) of the air in the world. A crashed flight ends at crashed_ns, its last
    row, touching floor or structure.
    """

    stamps_ns: NDArray[np.int64]
    positions_m: Array
    quaternions_wxyz: Array
    velocities_m_s: Array
    accelerations_m_s2: Array
    angular_velocities_rad_s: Array
    angular_accelerations_rad_s2: Array
    thrust_commands_n: Array
    thrusts_n: Array
    winds_m_s: Array
    status: Status = "completed"
    crashed_ns: int | None = None

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        stamps.setflags(write=False)
        object.__setattr__(self, "stamps_ns", stamps)
        n = stamps.size
        for name, columns in (
            ("positions_m", 3),
            ("quaternions_wxyz", 4),
            ("velocities_m_s", 3),
            ("accelerations_m_s2", 3),
            ("angular_velocities_rad_s", 3),
            ("angular_accelerations_rad_s2", 3),
            ("thrust_commands_n", 4),
            ("thrusts_n", 4),
            ("winds_m_s", 3),
        ):
            object.__setattr__(self, name, read_only(getattr(self, name), (n, columns)))
        if (self.status == "crashed") != (self.crashed_ns is not None):
            raise ValueError("a flight has a crash time exactly when its status is crashed")

    def __len__(self) -> int:
        return int(self.stamps_ns.size)

    @property
    def trajectory(self) -> Trajectory:
        """Trajectory world_from_body of every row."""
        return Trajectory(self.stamps_ns, self.positions_m, self.quaternions_wxyz)

    def pose(self, row: int) -> Pose:
        """Pose world_from_body of a row."""
        return Pose.from_quaternion(self.quaternions_wxyz[row], self.positions_m[row])

    def frame_rows(self, rate_hz: float) -> NDArray[np.int64]:
        """Rows nearest to the times of a camera at rate_hz, the first at 0; a frame's stamp is its row's own stamp.

        Pose and stamp of a frame so never disagree; a frame is early or late by at most half a row.
        ValueError when the camera is faster than the record.
        """
        step_ns = int(self.stamps_ns[1] - self.stamps_ns[0]) if len(self) > 1 else 10**9
        rows_per_frame = Fraction(10**9) / Fraction(str(rate_hz)) / step_ns
        if rows_per_frame < 1:
            raise ValueError(f"a camera at {rate_hz} Hz is faster than the record's {1e9 / step_ns:g} Hz")
        count = int((len(self) - 1) / rows_per_frame) + 1
        return np.array([round(i * rows_per_frame) for i in range(count)], dtype=np.int64)


@dataclass(frozen=True)
class FlightSpec:
    """What is flown: a path, a vehicle, its controller and the wind, and what is asked of the flight.

    A plan must keep clearance_m between the vehicle's sphere and everything else. Motors may be at their limits for
    saturation_share of the time. A crash is an error, or, with on_crash "record", ends the record there.
    """

    path: PathSpec = field(default_factory=HandPilot)
    airframe: AirframeSpec = field(default_factory=Crazyflie)
    control: Geometric = field(default_factory=Geometric)
    wind: WindSpec = field(default_factory=Still)
    clearance_m: Annotated[float, Ge(0)] = 0.1
    saturation_share: Annotated[float, Interval(ge=0, le=1)] = 0.05
    on_crash: Literal["error", "record"] = "error"


def fly(spec: FlightSpec, mount: Mount, surroundings: Surroundings, seed: int) -> Flight:
    """Fly a path and return its true record; the same arguments give the same bytes.

    The record begins settled: the vehicle has flown for some seconds before row 0. UserError for a path that leaves
    no room or needs more thrust than there is, a crash, motors at their limits, or a camera inside the structure.
    """
    vehicle = Quadrotor.from_mjcf(spec.airframe.build(mount))
    try:
        record = _record(spec, vehicle, mount, surroundings, seed)
        step = crash_step(record, vehicle, surroundings)
        if step is not None and spec.on_crash == "error":
            raise crash_error(record, step, surroundings)
        whole = record[: None if step is None else step + 1]
        whole = whole[np.isfinite(whole).all(axis=1)]
        check_camera(whole, mount, surroundings)
        if step is None:
            check_saturation(whole, vehicle, spec.saturation_share)
    except UserError as error:
        raise UserError(f"path {path_name(spec.path)}: {error}") from None
    return _flight(whole, crashed=step is not None)


def _record(spec: FlightSpec, vehicle: Quadrotor, mount: Mount, surroundings: Surroundings, seed: int) -> Array:
    guidance = spec.path.plan(surroundings, mount, stream(seed, "path"))
    if isinstance(guidance, Replay):
        return guidance.record
    air = spec.wind.start(guidance.warm_up + guidance.steps, STEP_S, stream(seed, "wind"))
    if isinstance(guidance, Planned):
        check_plan(guidance, vehicle, surroundings, air.mean_m_s[guidance.warm_up :], spec.clearance_m)
    return simulate(vehicle, spec.control.gains(), guidance, air, surroundings)


def _flight(record: Array, crashed: bool) -> Flight:
    return Flight(
        stamps_ns=np.arange(len(record), dtype=np.int64) * STEP_NS,
        positions_m=record[:, 0:3],
        quaternions_wxyz=record[:, 3:7],
        velocities_m_s=record[:, 7:10],
        accelerations_m_s2=record[:, 10:13],
        angular_velocities_rad_s=record[:, 13:16],
        angular_accelerations_rad_s2=record[:, 16:19],
        thrust_commands_n=record[:, 19:23],
        thrusts_n=record[:, 23:27],
        winds_m_s=record[:, 27:30],
        status="crashed" if crashed else "completed",
        crashed_ns=(len(record) - 1) * STEP_NS if crashed else None,
    )


def path_name(path: PathSpec) -> str:
    """Name of a path in PATHS, else that of its class."""
    return next((name for name, kind in PATHS.items() if type(path) is kind), type(path).__name__)
