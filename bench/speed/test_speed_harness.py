"""Time of the harness: planning, a frame through a pipe, the gate's bootstrap."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.bench.config.suite import load_suite
from uavbench.bench.external.program import External
from uavbench.bench.runner.jobs import plan
from uavbench.reports.statistics.bootstrap import Bootstrap
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.random_streams import stream

ROOT = Path(__file__).parents[2]
SUITE = """
title = "Many"
seeds = {seeds}
rates_hz = [15.0, 5.0]
[sequences.a]
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot" }}
[sequences.b]
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot" }}
[trackers]
hold = {{ kind = "hold" }}
lsd = {{ kind = "lsd" }}
"""
ECHO = """
import sys
print("ready", flush=True)
for line in sys.stdin.buffer:
    _, stamp, w, h, c = line.decode().strip().split(",")
    sys.stdin.buffer.read(int(w) * int(h) * int(c))
    print(stamp + ",lost", flush=True)
"""


def test_ten_thousand_cached_jobs_are_planned_again(benchmark: Any, tmp_path: Path) -> None:
    """Plan 1,112 sequences, 4,448 runs with their scores and the report, all of them up to date."""
    path = tmp_path / "many.toml"
    path.write_text(SUITE.format(seeds=list(range(556))))
    for job in plan(load_suite(path), tmp_path):
        job.marker.parent.mkdir(parents=True, exist_ok=True)
        job.marker.write_text(json.dumps({"content_hash": job.content_hash, "more": ["x" * 60] * 40}))

    def again() -> int:
        jobs = plan(load_suite(path), tmp_path)
        assert all(job.fresh for job in jobs)
        return len(jobs)

    assert benchmark.pedantic(again, rounds=3) > 10_000


def test_a_frame_through_the_pipe_of_an_external_tracker(benchmark: Any, tmp_path: Path) -> None:
    """Round trip of a 640 x 480 colour frame to a Python program and its answer."""
    program = tmp_path / "echo.py"
    program.write_text(ECHO)
    triangle = Structure.from_mesh(np.eye(3), np.array([[0, 1, 2]]))
    tracker = External(command=(sys.executable, str(program)))
    run = tracker.start(triangle, Camera.from_field_of_view(640, 480, 65.0), Pose.identity(), stream(0, "speed"))
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    stamp = iter(range(10**9))
    benchmark.pedantic(lambda: run.track(image, next(stamp)), rounds=200, warmup_rounds=5)


def test_the_bootstrap_of_one_metric_of_the_gate(benchmark: Any) -> None:
    """Bootstrap over ten sequences with ten seeds each."""
    differences = list(stream(0, "speed").normal(size=(10, 10)))
    benchmark.pedantic(Bootstrap.of, (differences,), {"rounds": 5}, rounds=10, warmup_rounds=1)
