"""Time per frame of the trackers on a box, 640x480, one thread; run with `pytest bench/speed --benchmark-only`."""

from typing import Any

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit
from tracker.base import Image
from tracker.segments import detect_segments, grey
from tracker.variants import TRACKERS
from trajectories.pose import Pose

FRAMES = 24
STEP_NS = 66_666_667
Flight = tuple[list[Pose], list[Image]]


@pytest.fixture(scope="module")
def flight() -> Flight:
    """Poses and frames of a short orbit around a box."""
    poses = orbit(FRAMES, seed=5)
    scene, rng = Scene([box_corners()], seed=5), np.random.default_rng(5)
    return poses, [scene.render(pose, noise_rng=rng) for pose in poses]


@pytest.mark.parametrize("kind", sorted(TRACKERS))
def test_frame(benchmark: Any, flight: Flight, kind: str) -> None:
    """One frame of a tracker that is under way."""
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
    """The segments of one frame."""
    cv2.setNumThreads(1)
    benchmark(detect_segments, grey(flight[1][0]))
