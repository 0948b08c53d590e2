"""Fly a sequence in closed loop: simulate, render, track, estimate, control, in lockstep and deterministic."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from uavbench.bench.closed_loop.checks import check_loop, loop_imu
from uavbench.bench.closed_loop.ending import Ending, Judge
from uavbench.bench.closed_loop.estimators import CameraAlone, Estimator, Filtered, Start, TrueState
from uavbench.bench.closed_loop.eye import CameraInFlight, WayFlown, exposed_after_ns, eye, mount_along
from uavbench.bench.closed_loop.flight_notes import Notes, mounts_of, unreached_in_flight
from uavbench.bench.closed_loop.latency import delay_of
from uavbench.bench.closed_loop.open_loop import OpenLoop
from uavbench.bench.closed_loop.sensing import Reading, Sensors
from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.bench.closed_loop.tracking import TrackerInFlight
from uavbench.reports.closed_loop.flown import Flown
from uavbench.scenes.dataset.body import Samples
from uavbench.scenes.renderables import Confines
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import Scene, build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.tracker.initialization import initial_pose_of
from uavbench.tracker.protocol import Image, TrackResult
from uavbench.tracker.run import own_copy, started, tracker_stream
from uavbench.trajectories.kernels.warm_up import prepare
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.registry import named
from uavbench.trajectories.sensors.sensor import check_rate, stamps_between
from uavbench.trajectories.simulation.flight import begin
from uavbench.trajectories.simulation.simulate import BLOCK, Simulation
from uavbench.trajectories.vehicle.quadrotor import STEP_NS
from uavbench.trajectories.vehicle.registry import vehicle_of

OnStep = Callable[[int, int], None]


def fly(spec: SequenceSpec, pilot: Pilot, on_step: OnStep | None = None) -> Flown:
    """Fly a sequence on its tracker's poses; deterministic unless the latency is measured.

    The vehicle is flown on its true state until its first frame is exposed, then on the estimate alone. on_step(steps
    done, all steps) reports progress. UserError before the start for a loop without sufficient sensors, for a flight
    that fails even on its true state, leaves the scene, or never sees the target of its gimbal, and for a tracker that
    cannot be started.
    """
    prepare(__name__)
    check_loop(pilot.loop, spec)
    scene = build_scene(spec)
    confines = Confines(scene.site, scene.room)
    open_loop = OpenLoop.of(spec, pilot.rate_hz, scene.obstacles, confines)
    notes = Notes(spec, pilot, open_loop)
    simulation = begin(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    simulation.warm_up()
    way = WayFlown(simulation)
    mount = mount_along(spec, scene, way)
    with eye(spec, scene, way, mount) as source:
        loop = Loop(spec, pilot, scene, simulation, CameraInFlight(source, mount), notes)
        while notes.ending is None and not simulation.is_over:
            loop.step()
            if on_step is not None and simulation.step % (10 * BLOCK) == 0:
                on_step(simulation.step, simulation.steps)
    verdicts = loop.estimator.verdicts if loop.estimator is not None else []
    notes.unreached = unreached_in_flight(spec.mount, mount, notes.stamps_ns)
    flown = notes.flown(simulation, loop.judge.radius_m, scene.built.structure, source.told, verdicts)
    return replace(flown, readings=loop.sensors.tables(), mounts=mounts_of(spec.mount, mount, flown))


class Loop:
    """All parts of a flight; one `step` is one control step of the vehicle.

    image, samples, true_cam_from_world: of the latest frame: its image, the sensor readings up to it, and the true pose
    of the camera. UserError for a loop whose sensors cannot hold the vehicle in a flight of this duration.
    """

    def __init__(
        self,
        spec: SequenceSpec,
        pilot: Pilot,
        scene: Scene,
        simulation: Simulation,
        camera: CameraInFlight,
        notes: Notes,
    ) -> None:
        self.spec, self.pilot, self.scene = spec, pilot, scene
        self.simulation, self.source, self.notes = simulation, camera.source, notes
        self.sensor_names = check_loop(pilot.loop, spec, simulation.steps * STEP_NS / 1e9)
        self.sensors = Sensors(spec, pilot.loop, simulation.steps, scene.obstacles, camera.mount)
        vehicle = vehicle_of(spec.flight.airframe, spec.mount.at_rest)
        self.judge = Judge(pilot.loop.crash, vehicle.radius_m, scene.obstacles)
        self.start_velocity_m_s = simulation.commanded[3:6].copy()
        self.latency_rng = stream(spec.seed, "loop", "latency")
        flown_ns = (simulation.steps - 1) * STEP_NS
        check_rate(pilot.rate_hz, flown_ns, "frame", "rates_hz")
        self.stamps = stamps_between(0, flown_ns, pilot.rate_hz).tolist()
        self.exposed_after_ns = exposed_after_ns(spec, camera.source)
        self.frame = 0
        self.busy_until_ns = -1
        self.due: list[tuple[int, int, TrackResult]] = []
        self.early: list[Reading] = []
        self.estimator: Estimator | None = None
        self.tracker: TrackerInFlight | None = None
        self.image: Image | None = None
        self.samples: dict[str, Samples] = {}
        self.true_cam_from_world: Pose | None = None

    def step(self) -> None:
        """One control step: observe, sense, track, estimate, command, integrate."""
        simulation = self.simulation
        simulation.observe()
        now_ns = simulation.step * STEP_NS
        self.sense()
        self.see(now_ns)
        self.deliver(now_ns)
        self.command(now_ns)
        simulation.advance()
        if simulation.step % BLOCK == 0 or simulation.is_over:
            self.look_for_the_end()

    def sense(self) -> None:
        """Pass the readings of the body's sensors to the estimator."""
        for reading in self.sensors.read(self.simulation.record, self.simulation.step):
            if self.estimator is None:
                self.early.append(reading)
            else:
                self.estimator.sense(reading)

    def see(self, now_ns: int) -> None:
        """Take and track the next frame once all of it is exposed."""
        if self.frame >= len(self.stamps) or now_ns < self.stamps[self.frame] + self.exposed_after_ns:
            return
        stamp_ns = self.stamps[self.frame]
        frame, self.frame = self.frame, self.frame + 1
        latency, exposed_ns = self.pilot.loop.latency, stamp_ns + self.exposed_after_ns
        light = self.source.image(stamp_ns)
        if light is None or exposed_ns < self.busy_until_ns:
            return
        image = encode(light)
        tracker = self.tracker or self.take_off(image)
        true_pose = self.source.cam_from_world(stamp_ns)
        told = len(tracker.faults)
        assert self.estimator is not None
        expected = self.estimator.expected(stamp_ns) if self.pilot.loop.prior else None
        self.image, self.samples, self.true_cam_from_world = image, self.sensors.upto(stamp_ns), true_pose
        result = tracker.track(image, stamp_ns, self.samples, expected, true_pose)
        begin_ns = exposed_ns if latency.occupies else stamp_ns
        answer_ns = begin_ns + delay_of(latency, result.stage_ms.get("total", 0.0), self.latency_rng)
        self.busy_until_ns = answer_ns if latency.occupies else -1
        self.due.append((max(answer_ns, now_ns), stamp_ns, result))
        self.notes.frame(frame, stamp_ns, result, true_pose, self.due[-1][0])
        if len(tracker.faults) > told and self.pilot.loop.on_fault == "end":
            self.notes.ending = Ending("stopped", f"the tracker failed: {tracker.faults[-1].what}", stamp_ns)

    def take_off(self, first: Image) -> TrackerInFlight:
        """Start tracker and filter at the first frame."""
        spec, pilot, camera = self.spec, self.pilot, self.source.told
        structure, seed = self.scene.built.structure, spec.seed
        pose, rng = self.source.cam_from_world(0), stream(seed, "initialization")
        pose = initial_pose_of(pilot.start, structure, camera, pose, first, rng)
        rng = tracker_stream(pilot.tracker, seed)
        run: Any = pilot.tracker
        if not isinstance(run, GroundTruth):
            run = started(own_copy(run), structure, camera, pose, rng, self.sensors.body)
        self.tracker = TrackerInFlight(run)
        start, mount = Start(pose, self.start_velocity_m_s), self.sensors.mount
        if pilot.loop.estimator == "truth":
            self.estimator = TrueState()
        elif pilot.loop.estimator == "camera":
            imu_name = loop_imu(self.sensor_names, spec)
            self.estimator = CameraAlone(imu_name, mount, start)
        else:
            imu: Any = named(spec.sensors)[loop_imu(self.sensor_names, spec)]
            self.estimator = Filtered(pilot.loop.filter, self.sensor_names, imu, mount, start)
        for reading in self.early:
            self.estimator.sense(reading)
        self.notes.faults = self.tracker.faults
        return self.tracker

    def deliver(self, now_ns: int) -> None:
        """Pass the tracker's results that are due by now to the estimator."""
        for answer in [answer for answer in self.due if answer[0] <= now_ns] if self.due else ():
            self.due.remove(answer)
            assert self.estimator is not None
            self.estimator.answer(answer[1], answer[2])

    def command(self, now_ns: int) -> None:
        """Command the vehicle by guidance and controller from the estimated state."""
        simulation = self.simulation
        estimator = self.estimator
        estimated = estimator.state_at(now_ns) if estimator is not None else None
        simulation.command(*(estimated or (simulation.qpos, simulation.qvel)))
        if simulation.step % BLOCK == 0:
            covariance = estimator.covariance(now_ns) if estimator is not None else None
            self.notes.row(simulation, estimated, covariance, self.sensors.has_fix)

    def planned(self, rows: slice) -> Array:
        """Reference rows (n, 17), the centre line of the corridor."""
        return self.simulation.reference[rows]

    def look_for_the_end(self) -> None:
        """Log the ending if the flight ended within the last steps."""
        simulation, loop = self.simulation, self.pilot.loop
        first = (simulation.step - 1) // BLOCK * BLOCK
        rows = slice(first, simulation.step)
        found = self.judge.ending(simulation.record[rows], self.planned(rows), first)
        if found is None and loop.time_limit_s is not None and simulation.step * STEP_NS >= loop.time_limit_s * 1e9:
            found = Ending("timed out", f"it took longer than {loop.time_limit_s:g} s", simulation.step * STEP_NS)
        self.notes.ending = self.notes.ending or found
