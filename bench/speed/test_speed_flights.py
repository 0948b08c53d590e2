"""Speed of flight: seconds simulated per second of one core; processor time of a flight in closed loop by that of its
frames, and of its sequence; processor time of the vehicle's filter.

`pytest bench/speed/test_speed_flights.py --benchmark-only`; the one of many flights uses every core.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import pytest

from uavbench.bench.closed_loop.eye import CameraInFlight, WayFlown, eye, mount_along
from uavbench.bench.closed_loop.flight_notes import Notes
from uavbench.bench.closed_loop.fly import Loop
from uavbench.bench.closed_loop.fly import fly as fly_closed
from uavbench.bench.closed_loop.open_loop import OpenLoop
from uavbench.bench.closed_loop.spec import Pilot
from uavbench.bench.config.suite import load_suite
from uavbench.bench.config.suite_files import suite_file
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import open_sequence
from uavbench.scenes.generate import generate
from uavbench.scenes.renderables import Confines
from uavbench.scenes.rendering.camera_simulator import CameraSimulator
from uavbench.scenes.rendering.radiance import Radiance, encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structure import Structure
from uavbench.tracker.fusion.camera_on_body import FixedMount
from uavbench.tracker.fusion.kernels import normalized_innovation, propagate, update
from uavbench.tracker.fusion.measurements import CameraPose
from uavbench.tracker.fusion.state import Estimate, FusionConfig
from uavbench.tracker.protocol import Image, Run, Tracker, TrackResult
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.around import Hover, Orbit
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Array, Pose
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.simulation.flight import FlightSpec, begin, fly
from uavbench.trajectories.wind.winds import Dryden

CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (0.0, 0.3)])
BOX = ObstacleMesh(CORNERS, np.array([[0, 1, 3], [4, 6, 7], [0, 4, 5], [2, 3, 7], [0, 2, 6], [1, 5, 7]]))
WINDY = FlightSpec(path=Hover(duration_s=60.0), wind=Dryden())
COUNT = 24


def whole_flight(seed: int, spec: FlightSpec = WINDY) -> float:
    """Fly and measure; the duration of the flight in s."""
    flight = fly(spec, Mount(), BOX, seed)
    measure((Imu(),), flight, BOX, seed)
    return float(flight.stamps_ns[-1]) / 1e9


def test_a_minute_with_wind_and_imu(benchmark: Any) -> None:
    """Controller, Dryden wind and IMU on one core."""
    whole_flight(0)
    benchmark.pedantic(whole_flight, args=(0,), rounds=5)
    benchmark.extra_info["times_real_time"] = 60.0 / benchmark.stats.stats.min


def test_a_minute_near_a_structure(benchmark: Any) -> None:
    """The same on an orbit with turbulence that grows near the structure."""
    spec = FlightSpec(path=Orbit(turns=2.0), wind=Dryden(near_gain=1.0))
    seconds = whole_flight(0, spec)
    benchmark.pedantic(whole_flight, args=(0, spec), rounds=5)
    benchmark.extra_info["times_real_time"] = seconds / benchmark.stats.stats.min


def test_a_hand_flown_flight(benchmark: Any) -> None:
    """The flight of suite `paper`, without its images."""
    spec = FlightSpec(path=HandPilot(duration_s=40.0))
    whole_flight(0, spec)
    benchmark.pedantic(whole_flight, args=(0, spec), rounds=5)
    benchmark.extra_info["times_real_time"] = 40.0 / benchmark.stats.stats.min


def test_many_flights_on_every_core(benchmark: Any) -> None:
    """Flights of one minute on all cores, extrapolated to a thousand of them."""
    cores = len(os.sched_getaffinity(0))
    whole_flight(0)
    with ProcessPoolExecutor(cores) as pool:
        list(pool.map(whole_flight, range(cores)))

        def fly_many() -> float:
            start = time.perf_counter()
            list(pool.map(whole_flight, range(COUNT)))
            return time.perf_counter() - start

        seconds = benchmark.pedantic(fly_many, rounds=2)
    benchmark.extra_info["cores"] = cores
    benchmark.extra_info["thousand_flights_minutes"] = seconds / COUNT * 1000 / 60


FLIGHT_S = 15.0
"""Duration of the flights: those of the suites cost several times as much in every round."""


class Watch:
    """Processor time spent on the frames of a flight, and on measuring it."""

    def __init__(self) -> None:
        self.frames_s = self.measuring_s = 0.0

    def around(self, source: CameraSimulator) -> CameraSimulator:
        """The camera, its images timed; each is encoded once more than in flight, to time that too."""

        def image(stamp_ns: int) -> Radiance | None:
            start = process_time()
            light = source.image(stamp_ns)
            drawn = process_time()
            if light is not None:
                encode(light)
            encoded = process_time()
            self.frames_s += encoded - start
            self.measuring_s += encoded - drawn
            return light

        return replace(source, image=image)


@dataclass(frozen=True)
class Timed:
    """A tracker whose frames are timed."""

    tracker: Tracker
    watch: Watch

    def start(self, structure: Structure, camera: Camera, cam_from_world: Pose, rng: np.random.Generator) -> Run:
        """Start a run."""
        return TimedRun(self.tracker.start(structure, camera, cam_from_world, rng), self.watch)


class TimedRun:
    """A run of `Timed`."""

    def __init__(self, run: Any, watch: Watch) -> None:
        self._run, self._watch = run, watch
        if hasattr(run, "predict"):
            self.predict = run.predict

    def track(self, image: Image, stamp_ns: int) -> TrackResult:
        """The run's result."""
        start = process_time()
        result: TrackResult = self._run.track(image, stamp_ns)
        self._watch.frames_s += process_time() - start
        return result


def flown(spec: SequenceSpec, pilot: Pilot) -> float:
    """Processor time of a flight, by that of rendering and tracking its frames; building the scene counts for neither.

    Both are taken of the same flight, frame by frame, so that other work on the machine weighs on both alike.
    """
    watch = Watch()
    scene = build_scene(spec)
    started = process_time()
    notes = Notes(spec, pilot, OpenLoop.of(spec, pilot.rate_hz, scene.obstacles, Confines(scene.site, scene.room)))
    simulation = begin(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    simulation.warm_up()
    simulated = process_time() - started
    way = WayFlown(simulation)
    mount = mount_along(spec, scene, way)
    with eye(spec, scene, way, mount) as source:
        timed = replace(pilot, tracker=Timed(pilot.tracker, watch))
        loop = Loop(spec, timed, scene, simulation, CameraInFlight(watch.around(source), mount), notes)
        started = process_time()
        while notes.ending is None and not simulation.is_over:
            loop.step()
        simulated += process_time() - started
    assert notes.ending is None, notes.ending
    return (simulated - watch.measuring_s) / watch.frames_s


class Flown(NamedTuple):
    """What is flown, and on which tracker."""

    spec: SequenceSpec
    pilot: Pilot


@pytest.fixture(scope="module")
def short() -> Flown:
    """The first flight of `fly-box`, shortened, on `robust`."""
    suite = load_suite(suite_file("fly-box"))
    spec = suite.sequences[0]
    assert isinstance(spec, SequenceSpec)
    path: Any = replace(spec.flight.path, duration_s=FLIGHT_S)  # type: ignore[type-var]
    spec = replace(spec, flight=replace(spec.flight, path=path))
    (loop,) = suite.loops.values()
    return Flown(spec, Pilot(label="robust", tracker=suite.trackers["robust"], rate_hz=spec.rate_hz, loop=loop))


def test_a_flight_against_its_frames(benchmark: Any, short: Flown) -> None:
    """A flight by the images and the calls of `track` within it alone; the median of the rounds."""
    flown(*short)
    times: list[float] = []
    benchmark.pedantic(lambda: times.append(flown(*short)), rounds=5)
    benchmark.extra_info["times_its_frames"] = float(np.median(times))


def test_a_flight_against_its_sequence(benchmark: Any, short: Flown, tmp_path: Path) -> None:
    """A flight by rendering its sequence and tracking that; the median of the rounds is held against the goal."""
    spec, pilot = short
    times: list[float] = []

    def both() -> None:
        begun = process_time()
        fly_closed(spec, pilot)
        landed = process_time()
        folder = tmp_path / str(len(times))
        generate(spec, folder, content_hash="speed")
        track_sequence(pilot.tracker, open_sequence(folder), rate_hz=pilot.rate_hz, seed=spec.seed)
        times.append((landed - begun) / (process_time() - landed))

    benchmark.pedantic(both, rounds=3, warmup_rounds=1)
    benchmark.extra_info["times_its_sequence"] = float(np.median(times[1:]))


@pytest.fixture(scope="module")
def config() -> FusionConfig:
    """The filter's defaults."""
    return FusionConfig()


def begun() -> Estimate:
    """A state at rest."""
    return Estimate.at_rest(0, Pose(np.eye(3), np.array([1.0, 2.0, 3.0])), position_m=0.01, attitude_rad=0.01)


def covariance_of(estimate: Estimate) -> Array:
    """Covariance (21, 21) of the filter's error at its start."""
    P = np.eye(21)
    P[:15, :15] = estimate.covariance
    return P


def test_a_propagation_of_the_filter(benchmark: Any, config: FusionConfig) -> None:
    """State and covariance over one interval of an IMU of 200 Hz."""
    start = begun()
    reading = np.array([0.1, -0.2, 0.3, 0.1, 0.2, 9.8])
    benchmark(propagate, start.pack(), covariance_of(start), reading, reading, 0.005, config.densities)


def test_an_update_of_the_filter(benchmark: Any, config: FusionConfig) -> None:
    """A camera pose: its innovation, the test at the gate, and the update."""
    start = begun()
    state, P = start.pack(), covariance_of(start)
    camera = FixedMount(Pose.identity()).at(0)
    pose = CameraPose.claimed(0, start.world_from_body.inverse(), 1e-4 * np.eye(6), camera, config)

    def updated() -> None:
        found = pose.innovation(state, np.zeros(3))
        normalized_innovation(P, found.residual, found.H, found.noise)
        update(state, P, found.residual, found.H, found.noise)

    benchmark(updated)
