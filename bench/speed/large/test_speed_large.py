"""`robust` on a facade of 1,458 windows, 139,980 edges: the start of a run, and its frames at 15 Hz."""

import time
from functools import cache
from typing import Any

import cv2
import numpy as np

from uavbench.bench.speed.large.facade import Facade
from uavbench.bench.speed.synthetic import CAMERA
from uavbench.tracker.protocol import Image, Run
from uavbench.tracker.registry import TRACKERS

LARGE = Facade(bays=54, storeys=27)
FRAMES, STEP_NS = 45, 66_666_667


@cache
def images() -> list[Image]:
    """Frames of three seconds along the facade."""
    rng = np.random.default_rng(3)
    return [LARGE.image(LARGE.pose(k * STEP_NS * 1e-9), rng) for k in range(FRAMES)]


def started() -> Run:
    """A run from the true initial pose."""
    cv2.setNumThreads(1)
    return TRACKERS["robust"]().start(LARGE.structure, CAMERA, LARGE.pose(0.0), np.random.default_rng(0))


def frames_ms() -> list[float]:
    """Processor time in ms of each frame of a flight, all of which have a pose."""
    run, times = started(), []
    for k, image in enumerate(images()):
        begin = time.process_time_ns()
        assert run.track(image, k * STEP_NS).status == "ok"
        times.append((time.process_time_ns() - begin) * 1e-6)
    return times


def test_structure_of_a_large_facade(benchmark: Any) -> None:
    """Welding its mesh and finding its edges."""
    facade = Facade(LARGE.bays, LARGE.storeys)
    facade.solids  # noqa: B018, made once
    benchmark.pedantic(lambda: facade.structure, rounds=1)
    benchmark.extra_info["edges"] = len(facade.structure.edges)


def test_start_on_a_large_facade(benchmark: Any) -> None:
    """The edge map, its groups and self-similarity, once for each run."""
    started()
    benchmark.pedantic(started, rounds=3)


def test_frames_of_a_large_facade(benchmark: Any) -> None:
    """Median and slowest frame, the first one included."""
    frames_ms()
    times_ms = benchmark.pedantic(frames_ms, rounds=1)
    benchmark.extra_info.update(p50_ms=float(np.median(times_ms)), slowest_ms=max(times_ms))
