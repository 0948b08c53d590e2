"""Reinforcement-learning environment of the closed loop, in the extra `uavbench[gym]`: fly an inspection by setpoints.

The vehicle, its camera, sensors, tracker and filter are those of a flight in closed loop; instead of guidance along the
path an agent gives a setpoint at each frame. Importing this module registers `uavbench/Inspection-v0` with Gymnasium.
"""

from contextlib import ExitStack
from dataclasses import replace
from typing import Any, SupportsFloat

import numpy as np

from uavbench.bench.closed_loop.checks import check_loop
from uavbench.bench.closed_loop.eye import CameraInFlight, WayFlown, eye, mount_along
from uavbench.bench.closed_loop.flight_notes import Notes
from uavbench.bench.closed_loop.fly import Loop
from uavbench.bench.closed_loop.open_loop import OpenLoop
from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.loops import without_loop
from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.reports.closed_loop.coverage import sees, surface_points
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.protocol import Image
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.paths.reference import Guidance, VehicleState
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.registry import named
from uavbench.trajectories.simulation.flight import begin
from uavbench.trajectories.simulation.simulate import Simulation
from uavbench.trajectories.vehicle.geometric_control import REFERENCE_COLUMNS
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

try:
    import gymnasium
    from gymnasium import spaces
except ImportError:
    raise UserError("the environment needs Gymnasium: pip install 'uavbench[gym]'") from None

NAME = "uavbench/Inspection-v0"
REACH_M, REACH_RAD = 0.5, 0.5
"""Offset of the setpoint from the estimated state for an action of 1; at the camera's rate it allows several m/s,
limited by the controller.
"""
CRASH_REWARD = -1.0
"""Reward of a crash: minus that of covering the whole surface."""

Observation = dict[str, Any]


class Commanded:
    """Guidance that holds the agent's setpoint once there is one.

    planned: reference rows (steps, 17) of the path, filled as the flight goes; setpoint (4,): position in m in the
    world, yaw in rad.
    """

    def __init__(self, path: Guidance) -> None:
        self._path, self.warm_up, self.steps = path, path.warm_up, path.steps
        self.planned = np.zeros((path.steps, REFERENCE_COLUMNS))
        self.setpoint: Array | None = None

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        """Reference rows (count, 17): at rest at the setpoint, or those of the path without one."""
        rows = self._path.rows(first, count, state)
        if first >= 0:
            self.planned[first : first + count] = rows
        if self.setpoint is None:
            return rows
        held = np.zeros_like(rows)
        held[:, 0:3], held[:, 9] = self.setpoint[:3], self.setpoint[3]
        return held


class CommandedLoop(Loop):
    """A loop whose corridor is around the path, not around the setpoints."""

    guidance: Commanded

    def planned(self, rows: slice) -> Array:
        """Reference rows (n, 17) of the path."""
        return self.guidance.planned[rows]


class InspectionEnv(gymnasium.Env[Observation, Array]):
    """Inspection of a structure by setpoints from camera images; a step is one frame of the camera.

    Observation: `image` (h, w, 3) BGR; `imu` (n, 6) latest readings, rad/s and m/s^2, padded with the oldest one;
    `estimate` (13,) of the loop's estimator: position in the world in m, quaternion wxyz, velocity in the world in m/s,
    body rates in rad/s; `planned` (4,) position on the sequence's path in m and yaw in rad. Action (4,) from -1 to 1:
    setpoint relative to the estimated position (REACH_M along each world axis) and yaw (REACH_RAD). Reward: share of
    the structure's surface first seen in this frame at the loop's `coverage_px_m`; CRASH_REWARD for a crash, for
    straying from the path, and for a tracker's fault where the loop ends on it. Truncated at the end of the path or at
    the loop's time limit. The seed of `reset` replaces the sequence's: scene, wind, noise and path. UserError when the
    loop cannot fly the sequence, or it has no IMU.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, spec: SequenceSpec, pilot: Pilot, render_mode: str | None = None) -> None:
        prepare(__name__)
        sensor_names = check_loop(pilot.loop, spec)
        imus = {name: sensor for name, sensor in named(spec.sensors).items() if isinstance(sensor, Imu)}
        if not imus:
            raise UserError(f"sequence {spec.name}: the environment observes an IMU; name one in its `sensors`")
        self._spec, self._pilot, self.render_mode = spec, pilot, render_mode
        self.metadata = {**self.metadata, "render_fps": round(pilot.rate_hz)}
        self._imu = next((name for name in imus if name in sensor_names), next(iter(imus)))
        self._readings = max(1, int(imus[self._imu].rate_hz / pilot.rate_hz))
        camera = spec.camera.camera()
        self.observation_space = spaces.Dict({
            "image": spaces.Box(0, 255, (camera.height, camera.width, 3), np.uint8),
            "imu": any_number(self._readings, 6),
            "estimate": any_number(13),
            "planned": any_number(4),
        })  # fmt: skip
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float64)
        self._open = ExitStack()
        self._loop: CommandedLoop | None = None
        self._scene: tuple[int, Scene] | None = None

    @classmethod
    def of_suite(cls, suite: str, tracker: str, loop: str = "", **options: Any) -> "InspectionEnv":
        """Environment of the first sequence of a suite, given by name or file, with one of its trackers and loops.

        UserError when the suite has no loops, or no tracker or loop of the name.
        """
        found = load_suite(suite_file(suite))
        if not found.loops:
            raise without_loop(found.name)
        if tracker not in found.trackers:
            raise unknown_name("tracker", tracker, list(found.trackers))
        if loop not in found.loops:
            raise unknown_name("loop", loop, [name or "'', the only one" for name in found.loops])
        specs = [spec for spec in found.sequences if isinstance(spec, SequenceSpec)]
        pilot = Pilot(
            label=tracker, tracker=found.trackers[tracker], rate_hz=found.rates_hz[0], loop=found.loops[loop],
            start=found.start, variant=loop,
        )  # fmt: skip
        return cls(specs[0], pilot, **options)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a flight; its first frame, and `coverage` (0 to 1) so far.

        seed: of the sequence; without one it is drawn. UserError when the flight ends before its first frame.
        """
        super().reset(seed=seed)
        self.close()
        own = int(self.np_random.integers(2**31)) if seed is None else seed
        spec = replace(self._spec, seed=own)
        if self._scene is None or self._scene[0] != own:
            self._scene = (own, build_scene(spec))
        scene = self._scene[1]
        simulation = begin(spec.flight, spec.mount.at_rest, scene.obstacles, own, self._guided)
        simulation.warm_up()
        way = WayFlown(simulation)
        mount = mount_along(spec, scene, way)
        source = self._open.enter_context(eye(spec, scene, way, mount))
        nothing = OpenLoop(np.zeros((0, 5)), np.zeros(0))
        notes = Notes(spec, self._pilot, nothing)
        self._loop = CommandedLoop(spec, self._pilot, scene, simulation, CameraInFlight(source, mount), notes)
        self._loop.guidance = self._guidance
        self._points, self._normals = surface_points(scene.built.structure)
        self._seen = np.zeros(len(self._points), dtype=bool)
        self._heard, self._heard_ns = np.zeros((0, 6)), -1
        while self._loop.image is None and self._flies(self._loop):  # effects may drop frames
            self._to_next_frame(self._loop)
        if self._loop.image is None:
            raise UserError(f"sequence {spec.name}, seed {own}: the flight ends before the camera gives a frame")
        self._look(self._loop)
        return self._observed(self._loop), {"coverage": float(self._seen.mean())}

    def step(self, action: Array) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Fly towards a setpoint until the next frame; action (4,) is clipped to [-1, 1].

        UserError before the first `reset`, and for an action that is not four finite numbers.
        """
        loop = self._loop
        if loop is None:
            raise UserError("the environment is not initialized; call reset")
        given = np.asarray(action, dtype=float)
        if given.shape != (4,) or not np.isfinite(given).all():
            raise UserError(f"an action is four numbers from -1 to 1 (x, y, z, yaw), not {given.tolist()}")
        believed = self._believed(loop)
        way = np.clip(given, -1.0, 1.0) * [REACH_M, REACH_M, REACH_M, REACH_RAD]
        self._guidance.setpoint = np.append(believed[:3], yaw_of(believed)) + way
        self._to_next_frame(loop)
        ending = loop.notes.ending
        failed = ending is not None and ending.status in ("crashed", "strayed", "stopped")
        reward = CRASH_REWARD if failed else self._look(loop)
        over = not failed and (ending is not None or loop.simulation.is_over)
        about = {"coverage": float(self._seen.mean()), "status": ending.status if ending else "", "why": ""}
        return self._observed(loop), reward, failed, over, {**about, "why": ending.why if ending else ""}

    def render(self) -> Any:
        """The latest image (h, w, 3) RGB; None before the first frame, or in another mode than `rgb_array`."""
        if self.render_mode != "rgb_array" or self._loop is None or self._loop.image is None:
            return None
        return self._loop.image[..., ::-1].copy()

    def close(self) -> None:
        """Release the renderer."""
        self._open.close()
        self._loop = None

    def _guided(self, path: Guidance) -> Guidance:
        self._guidance = Commanded(path)
        return self._guidance

    @staticmethod
    def _flies(loop: Loop) -> bool:
        """Whether the flight is still in progress."""
        return loop.notes.ending is None and not loop.simulation.is_over

    def _to_next_frame(self, loop: Loop) -> None:
        """Fly until the next frame's time, or to the end."""
        before = loop.frame
        while loop.frame == before and self._flies(loop):
            loop.step()

    def _look(self, loop: Loop) -> float:
        """Share of the surface first seen in the latest frame."""
        assert loop.true_cam_from_world is not None
        rows = np.flatnonzero(~self._seen)
        new = sees(
            loop.source.camera, loop.true_cam_from_world, loop.scene.obstacles,
            self._points[rows], self._normals[rows], self._pilot.loop.coverage_px_m,
        )  # fmt: skip
        self._seen[rows] = new
        return float(new.sum() / len(self._seen))

    def _believed(self, loop: Loop) -> Array:
        """Estimated position, quaternion wxyz, velocity and body rates (13,); the true state without an estimator."""
        simulation: Simulation = loop.simulation
        at_ns = simulation.step * STEP_NS
        believed = loop.estimator.state_at(at_ns) if loop.estimator is not None else None
        qpos, qvel = believed or (simulation.qpos, simulation.qvel)
        return np.concatenate([qpos, qvel])

    def _observed(self, loop: Loop) -> Observation:
        step = min(loop.simulation.step, loop.simulation.steps) - 1
        image: Image | None = loop.image
        assert image is not None
        return {
            "image": image,
            "imu": self._latest_readings(loop),
            "estimate": self._believed(loop),
            "planned": self._guidance.planned[max(step, 0)][[0, 1, 2, 9]],
        }

    def _latest_readings(self, loop: Loop) -> Array:
        """The latest readings (n, 6) of the IMU, of earlier frames too where this one brought fewer."""
        given = loop.samples[self._imu]
        new = given.stamps_ns > self._heard_ns
        self._heard = np.vstack([self._heard, given.values[new]])[-self._readings :]
        self._heard_ns = int(given.stamps_ns.max(initial=self._heard_ns))
        missing = self._readings - len(self._heard)
        return np.vstack([np.tile(self._heard[:1], (missing, 1)), self._heard])


def any_number(*shape: int) -> spaces.Box[np.float64]:
    """Unbounded float64 space of arrays of a shape."""
    return spaces.Box(-np.inf, np.inf, shape, dtype=np.float64)


def yaw_of(believed: Array) -> float:
    """Yaw in rad of an estimated state (13,)."""
    w, x, y, z = believed[3:7]
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def make(**given: Any) -> InspectionEnv:
    """Entry point of `gymnasium.make`, with the arguments of `InspectionEnv.of_suite`."""
    return InspectionEnv.of_suite(**given)


if NAME not in gymnasium.registry:
    gymnasium.register(NAME, entry_point=make)
