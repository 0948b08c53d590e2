"""Overhead of the harness over a whole suite, and speed-up by a second worker.

The suite is long enough for the start-up of the processes to be a small share of it.
"""

import json
import subprocess
import sys
import time
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from uavbench.bench.speed.rounds import figure

SEQUENCES = 24
SUITE = f"""
title = "Short flights"
seeds = {list(range(SEQUENCES))}
rates_hz = [15.0]
[sequences.box]
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot", duration_s = 2.0 }}
camera = {{ width = 640, height = 480, horizontal_fov_deg = 65.0 }}
effects = [{{ kind = "motion-blur" }}, {{ kind = "noise" }}]
[trackers]
rapid = {{ kind = "rapid" }}
"""


def run(suite: Path, out: Path, workers: int) -> tuple[float, float]:
    """Wall-clock time of the whole command, and the sum of the times of its jobs, in s."""
    command = [
        sys.executable,
        "-m",
        "uavbench.bench.cli.main",
        "score",
        str(suite),
        "--out",
        str(out),
        "--jobs",
        str(workers),
    ]
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin, sum(json.loads((out / "seconds.json").read_text())["seconds"].values())


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The suite's file."""
    path = tmp_path_factory.mktemp("suite") / "suite.toml"
    path.write_text(SUITE)
    return path


def test_the_share_of_the_harness_in_a_suite(benchmark: Any, suite: Path, tmp_path: Path) -> None:
    """Share in percent of the wall-clock time outside of jobs: start-up, imports, planning, waiting."""
    out = (tmp_path / str(k) for k in count())

    def percent() -> float:
        wall_s, jobs_s = run(suite, next(out), 1)
        return 100 * (wall_s - jobs_s) / wall_s

    figure(benchmark, "percent_of_the_wall_time", percent)


def test_two_workers_against_one(benchmark: Any, suite: Path, tmp_path: Path) -> None:
    """Wall-clock time with one worker over that with two."""
    out = (tmp_path / str(k) for k in count())

    def ratio() -> float:
        return run(suite, next(out), 1)[0] / run(suite, next(out), 2)[0]

    figure(benchmark, "times_as_fast", ratio)
