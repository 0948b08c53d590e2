"""Time per frame of the trackers at 640 x 480 px in one thread; run with `pytest bench/speed --benchmark-only`."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from uavbench.bench.speed.synthetic import CAMERA, Scene, box, box_corners, orbit
from uavbench.bench.speed.test_speed_scenes import first_of
from uavbench.scenes.camera import Camera
from uavbench.scenes.camera_path import camera_path
from uavbench.scenes.filming.film import with_effects
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.scene import build_scene
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import Image, Run, Tracker
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.shang_shen.segments import detect_segments, grey
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.sensor import sample_stamps
from uavbench.trajectories.simulation.flight import fly

FRAMES = 24
STEP_NS = 66_666_667
Flight = tuple[list[Pose], list[Image]]
FILMED, WARM_UP = 75, 10
"""Frames of a suite that `robust` is run on, and the first of them that are not timed."""


@pytest.fixture(scope="module")
def flight() -> Flight:
    """Poses and frames of a short orbit around a box."""
    poses = orbit(FRAMES, seed=5)
    scene, rng = Scene([box_corners()], seed=5), np.random.default_rng(5)
    return poses, [scene.render(pose, noise_rng=rng) for pose in poses]


@pytest.mark.parametrize("kind", sorted(TRACKERS))
def test_frame(benchmark: Any, flight: Flight, kind: str) -> None:
    """One frame of a tracker after FRAMES // 2 others."""
    poses, images = flight
    cv2.setNumThreads(1)
    run = TRACKERS[kind]().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i in range(FRAMES // 2):
        run.track(images[i], i * STEP_NS)
    frames = iter(range(FRAMES // 2, FRAMES))

    def setup() -> tuple[tuple[Image, int], dict[str, Any]]:
        i = next(frames)
        return (images[i], i * STEP_NS), {}

    benchmark.pedantic(run.track, setup=setup, rounds=FRAMES // 2)


def test_lsd_alone(benchmark: Any, flight: Flight) -> None:
    """Detection of the line segments of one frame."""
    cv2.setNumThreads(1)
    benchmark(detect_segments, grey(flight[1][0]))


@dataclass(frozen=True, eq=False)
class Film:
    """The first grey frames of the first flight of a suite, and cam_from_world of the first of them."""

    structure: Structure
    camera: Camera
    first: Pose
    stamps_ns: list[int]
    images: list[Image]

    def run(self, tracker: Tracker) -> Run:
        """A run of a tracker on this film, from the true initial pose."""
        return tracker.start(self.structure, self.camera, self.first, np.random.default_rng(0))


@cache
def film(suite: str) -> Film:
    """The first FILMED frames of a suite's first sequence, without those that its effects drop."""
    spec = first_of(suite)
    scene = build_scene(spec)
    flight = fly(spec.flight, spec.mount.at_rest, scene.obstacles, spec.seed)
    camera = spec.camera.camera()
    pinhole, lens = render_camera(camera, 0)
    stamps_ns = sample_stamps(flight, spec.rate_hz)[:FILMED].tolist()
    with scene.renderer(pinhole.width, pinhole.height) as renderer:
        path = camera_path(flight, spec.mount.at_rest.cam_from_body)
        source = with_effects(ideal_camera(renderer, camera, pinhole, lens, path), spec.effects, spec.seed)
        lights = [source.image(stamp_ns) for stamp_ns in stamps_ns]
    images = [grey(encode(light)) for light in lights if light is not None]
    return Film(scene.built.structure, camera, path(stamps_ns[0]), stamps_ns, images)


def film_ms(suite: str) -> Callable[[], list[float]]:
    """A function that runs `robust` on the film of a suite; processor time in ms of each frame after WARM_UP."""
    cv2.setNumThreads(1)
    seen = film(suite)

    def track() -> list[float]:
        run = seen.run(TRACKERS["robust"]())
        times = []
        for image, stamp_ns in zip(seen.images, seen.stamps_ns, strict=True):
            begin = time.process_time_ns()
            assert run.track(image, stamp_ns).status == "ok"
            times.append((time.process_time_ns() - begin) * 1e-6)
        return times[WARM_UP:]

    return track


def timed_film(benchmark: Any, suite: str) -> None:
    """Time `robust` on a film after a run that compiles every kernel."""
    track = film_ms(suite)
    track()
    times_ms = benchmark.pedantic(track, rounds=1)
    benchmark.extra_info.update(p50_ms=float(np.median(times_ms)), p99_ms=float(np.percentile(times_ms, 99)))


def test_robust_on_the_box(benchmark: Any) -> None:
    """Median time per frame of a box in a room."""
    timed_film(benchmark, "box")


def test_slow_frames_of_robust_on_the_box(benchmark: Any) -> None:
    """99th percentile of the times of these frames."""
    timed_film(benchmark, "box")


def test_robust_on_the_bridge(benchmark: Any) -> None:
    """Median time per frame of a bridge outdoors."""
    timed_film(benchmark, "bridge")


LOST_FOR, LOST_AT = 10, 30
"""Frames of a film that are black, and the first of them."""


def interrupted_ms(suite: str) -> list[float]:
    """Processor time in ms of every frame of a film, with initialization, lost frames and relocalization.

    The initial pose is off by 4 % of the range and 4 deg, and LOST_FOR frames are black.
    """
    cv2.setNumThreads(1)
    seen = film(suite)
    range_m = float(np.linalg.norm(seen.first.transform(seen.structure.bounds.mean(axis=0, keepdims=True))))
    unit = np.full(3, 1 / np.sqrt(3))
    away = Pose.exp(np.concatenate([0.04 * range_m * unit, np.radians(4.0) * unit]))
    run = TRACKERS["robust"]().start(seen.structure, seen.camera, away @ seen.first, np.random.default_rng(0))
    black = [np.full_like(seen.images[0], k % 2) for k in range(LOST_FOR)]
    images = [*seen.images[:LOST_AT], *black, *seen.images[LOST_AT + LOST_FOR :]]
    times = []
    for image, stamp_ns in zip(images, seen.stamps_ns, strict=True):
        begin = time.process_time_ns()
        run.track(image, stamp_ns)
        times.append((time.process_time_ns() - begin) * 1e-6)
    return times


@pytest.mark.parametrize("suite", ["box", "bridge"])
def test_slowest_frame_of_robust(benchmark: Any, suite: str) -> None:
    """The slowest of all frames, including initialization and lost frames."""
    interrupted_ms(suite)
    times_ms = benchmark.pedantic(interrupted_ms, args=(suite,), rounds=1)
    benchmark.extra_info.update(slowest_ms=max(times_ms), p99_ms=float(np.percentile(times_ms, 99)))
