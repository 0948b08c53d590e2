"""Time per frame of our trackers relative to ViSP's, which tracks the same frame right after.

Wall-clock time, since ViSP runs in its own process; other load on the machine slows both alike.
"""

import time
from typing import Any

import cv2
import numpy as np
import pytest

from uavbench.bench.speed.test_speed_tracker import WARM_UP, Film, film
from uavbench.bench.third_party.visp import Visp
from uavbench.tracker.protocol import Image, Run, Tracker
from uavbench.tracker.registry import TRACKERS
from uavbench.trajectories.pose import Array

SEEN = 40
"""Frames that are tracked: ViSP takes most of a second for one of the bridge."""


@pytest.mark.parametrize("suite", ["paper", "bridge"])
def test_robust_against_visp(benchmark: Any, suite: str) -> None:
    """`robust` on a box and on a bridge."""
    time_against_visp(benchmark, "robust", suite)


def test_lsd_against_visp(benchmark: Any) -> None:
    """`lsd` on a box."""
    time_against_visp(benchmark, "lsd", "paper")


def time_against_visp(benchmark: Any, kind: str, suite: str) -> None:
    """Time a tracker of ours and ViSP on a film; `absent` holds the reason where ViSP is not installed."""
    cv2.setNumThreads(1)
    seen = film(suite)
    why = Visp.absence()
    trackers = {kind: TRACKERS[kind](), **({} if why else {"visp": Visp()})}

    times_ms = benchmark.pedantic(frames_ms, (seen, trackers), rounds=1)
    p50_ms = {f"{name}_p50_ms": float(np.median(ms)) for name, ms in times_ms.items()}
    ratio = {"absent": f"visp: {why}"} if why else {"times_visp": p50_ms[f"{kind}_p50_ms"] / p50_ms["visp_p50_ms"]}
    benchmark.extra_info.update(p50_ms, **ratio)


def frames_ms(seen: Film, trackers: dict[str, Tracker]) -> dict[str, Array]:
    """Wall-clock times (n,) in ms of each tracker after WARM_UP frames; the trackers take turns on each frame."""
    runs = {name: seen.run(tracker) for name, tracker in trackers.items()}
    frames = list(zip(seen.images, seen.stamps_ns, strict=True))[:SEEN]
    rows = [[frame_ms(run, *frame) for run in runs.values()] for frame in frames]
    return dict(zip(runs, np.array(rows[WARM_UP:]).T, strict=True))


def frame_ms(run: Run, image: Image, stamp_ns: int) -> float:
    """Wall-clock time in ms of one frame, lost or not."""
    begin = time.perf_counter_ns()
    run.track(image, stamp_ns)
    return (time.perf_counter_ns() - begin) * 1e-6
