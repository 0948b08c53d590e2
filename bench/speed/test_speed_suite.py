"""Overhead of the harness over a whole suite, and speed-up by a second worker.

The suite is as long as makes the start of the processes count little, as it does in any suite worth a second worker.
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
    """Wall time of the whole command, and the sum of the times of its jobs, in seconds."""
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
    """All wall time of the command that is not inside a job: starts, imports, planning, waiting, in percent."""
    out = (tmp_path / str(k) for k in count())

    def percent() -> float:
        wall_s, jobs_s = run(suite, next(out), 1)
        return 100 * (wall_s - jobs_s) / wall_s

    figure(benchmark, "percent_of_the_wall_time", percent)


def test_two_workers_against_one(benchmark: Any, suite: Path, tmp_path: Path) -> None:
    """One worker's wall time over that of two."""
    out = (tmp_path / str(k) for k in count())

    def ratio() -> float:
        return run(suite, next(out), 1)[0] / run(suite, next(out), 2)[0]

    figure(benchmark, "times_as_fast", ratio)
