"""Log of a flight in progress, and the flight written from it."""

from collections.abc import Callable
from collections.abc import Sequence as ListOf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.ending import Ending
from uavbench.bench.closed_loop.estimators import Believed
from uavbench.bench.closed_loop.open_loop import OpenLoop
from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.closed_loop.tracking import TimedFault
from uavbench.reports.closed_loop.flown import Flown, FlownPath, plan_stamps, planned_bodies
from uavbench.reports.closed_loop.flown_mounts import MOUNT_COLUMNS, FlownMounts
from uavbench.scenes.camera import Camera
from uavbench.scenes.rendering import context as gl
from uavbench.scenes.shots.targets import missed_target
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structure import Structure
from uavbench.tracker.fusion.events import Verdict
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.tracker.run import parameters, record_of
from uavbench.trajectories.camera_mount import MAIN, MountSpec
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.gimbal.motion import GimbalMotion
from uavbench.trajectories.pose import Array, Pose, rotation_from_quaternion, rotation_log
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.sensors.sensor import Table
from uavbench.trajectories.simulation.simulate import Simulation
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.vehicle.quadrotor import STEP_NS


def nees(path: FlownPath, rows: list[int], covariances: Array) -> Array:
    """NEES (n,) of position, velocity and attitude in rows of a path, for covariances (n, 9, 9)."""

    def error(name: str) -> Array:
        return path.group(f"true_{name}")[rows] - path.group(f"estimated_{name}")[rows]

    estimated, true = (rotation_from_quaternion(path.group(f"{kind}_q")[rows]) for kind in ("estimated", "true"))
    turn = rotation_log(np.swapaxes(estimated, 1, 2) @ true)
    errors = np.hstack([error("p_m"), error("v_m_s"), turn])
    weighed = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    return np.asarray((errors * weighed).sum(axis=1))


class Notes:
    """Log of one flight; `ending` is None while it goes on."""

    def __init__(self, spec: SequenceSpec, pilot: Pilot, open_loop: OpenLoop) -> None:
        self._spec, self._pilot, self._open_loop = spec, pilot, open_loop
        on_gimbal = isinstance(spec.mount, Gimbal)
        self._cam_from_evaluated = Pose.identity() if on_gimbal else spec.mount.at_rest.cam_from_body
        self.ending: Ending | None = None
        self.faults: list[TimedFault] = []
        self.unreached: list[str] = []
        self._rows: list[Array] = []
        self._claimed: dict[int, Array] = {}
        self._stamps: list[int] = []
        self._frames: list[tuple[int, int, TrackResult, int]] = []
        self._true_poses: list[Pose] = []

    def row(self, simulation: Simulation, believed: Believed | None, covariance: Array | None, has_fix: bool) -> None:
        """Log true, estimated and planned state of the current step."""
        state, planned = simulation.record[simulation.step], simulation.reference[simulation.step]
        true_q, true_p, true_v = (state[RECORD[k]] for k in ("quaternions_wxyz", "positions_m", "velocities_m_s"))
        estimate = np.full(14, np.nan)
        if believed is not None:
            estimate[:10] = *believed.qpos, *believed.qvel[:3]
        if covariance is not None:
            self._claimed[len(self._rows)] = covariance
        fix = [float(has_fix)]
        self._rows.append(np.concatenate([true_p, true_q, true_v, estimate, planned[0:3], planned[9:10], fix]))
        self._stamps.append(simulation.step * STEP_NS)

    def frame(self, frame: int, stamp_ns: int, result: TrackResult, true_pose: Pose, answered_ns: int) -> None:
        """Log a frame, the tracker's result, and when it reached the filter."""
        self._frames.append((frame, stamp_ns, result, answered_ns))
        self._true_poses.append(true_pose.inverse() @ self._cam_from_evaluated)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps (n,) of the frames so far."""
        return np.array([stamp for _, stamp, _, _ in self._frames], dtype=np.int64)

    def flown(
        self, simulation: Simulation, radius_m: float, structure: Structure, camera: Camera, verdicts: ListOf[Verdict]
    ) -> Flown:
        """The flight as it is written to disk."""
        stamps = self.stamps_ns
        results = Results(
            self._record(simulation, radius_m),
            np.array([frame for frame, _, _, _ in self._frames], dtype=np.int64),
            stamps,
            tuple(result for _, _, result, _ in self._frames),
        )
        return Flown(
            results=results,
            groundtruth=Trajectory.from_poses(stamps.tolist(), self._true_poses),
            path=self._path(),
            plan=self._open_loop.plan,
            answered_ns=np.array([answered for _, _, _, answered in self._frames], dtype=np.int64),
            innovations=[[v.stamp_ns, v.kind, v.d2, v.dof, v.why] for v in verdicts],
            structure=structure,
            camera=camera,
        )

    def _path(self) -> FlownPath:
        """The logged rows, with the claimed standard deviations and NEES of the estimates."""
        path = FlownPath(np.array(self._stamps, dtype=np.int64), np.array(self._rows))
        rows = list(self._claimed)
        if rows:
            covariances = np.array(list(self._claimed.values()))
            path.group("sigma_p_m")[rows] = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)[:, :3])
            path.group("nees")[rows, 0] = nees(path, rows, covariances)
        return path

    def _record(self, simulation: Simulation, radius_m: float) -> dict[str, Any]:
        spec, pilot = self._spec, self._pilot
        last_ns = (simulation.steps - 1) * STEP_NS
        ending = self.ending or Ending("completed", "", last_ns)
        inputs = {
            "label": pilot.label,
            "run": pilot.run,
            "sequence": {"name": spec.name},
            "start": {"kind": type(pilot.start).__name__, "parameters": parameters(pilot.start)},
            "loop": pilot.described_loop(),
        }
        errors = [f"t = {fault.stamp_ns / 1e9:.3f} s: {fault.what}" for fault in self.faults]
        record = record_of(
            pilot.tracker, inputs, self._cam_from_evaluated, rate_hz=pilot.rate_hz, seed=spec.seed, errors=errors
        )
        error_m = self._open_loop.error_m[: ending.stamp_ns // STEP_NS + 1]  # as far as this flight came
        flight = {
            "status": ending.status,
            "why": ending.why,
            "ended_s": ending.stamp_ns / 1e9,
            "planned_s": last_ns / 1e9,
            "radius_m": radius_m,
            "open_loop_rms_m": float(np.sqrt(np.mean(error_m**2))),
            "open_loop_max_m": float(error_m.max()),
        }
        record["versions"]["gl"] = gl.version()
        return {**record, "flight": flight} | ({"unreached": self.unreached} if self.unreached else {})


def unreached_in_flight(mount: MountSpec, motion: Callable[[int], Pose], stamps_ns: NDArray[np.int64]) -> list[str]:
    """What kept the gimbal of a flight from its target at its frames; that it saw none is no error any more."""
    if not (isinstance(mount, Gimbal) and isinstance(motion, GimbalMotion) and len(stamps_ns)):
        return []
    try:
        what = mount.unreached(motion, stamps_ns)
    except UserError as error:
        what = str(error)
    return [missed_target(MAIN, what)] if what else []


def mounts_of(mount: MountSpec, motion: Callable[[int], Pose], flown: Flown) -> FlownMounts | None:
    """The gimbal along its motion at the rows of the path, and at rest at those of the plan; None for a fixed mount."""
    if not (isinstance(mount, Gimbal) and isinstance(motion, GimbalMotion)):
        return None
    path_ns, plan_ns = flown.path.stamps_ns, plan_stamps(flown.plan)
    resting = [motion.at_rest_on(body) for body in planned_bodies(flown.plan)]
    return FlownMounts(
        flown=_table(mount, path_ns, motion.angles(path_ns)),
        planned=_table(mount, plan_ns, np.array(resting).reshape(-1, 3)),
    )


def _table(gimbal: Gimbal, stamps_ns: NDArray[np.int64], angles_rad: Array) -> Table:
    poses = [gimbal.cam_from_body(*angles) for angles in angles_rad.tolist()]
    rows = [[*pose.translation, *pose.quaternion_wxyz] for pose in poses]
    return Table(MOUNT_COLUMNS, stamps_ns, np.hstack([np.array(rows).reshape(-1, 7), angles_rad]))
