"""How fast two long trajectory files are evaluated, from the command line to its table.

`pytest bench/speed/test_speed_files.py --benchmark-only`; 1,000,000 poses each, 160 MB.
"""

import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

POSES = 1_000_000
START_NS, STEP_NS = 1_403_636_579_763_555_584, 5_000_000


def test_a_million_poses_evaluated(benchmark: Any, tmp_path: Path) -> None:
    """`uavbench evaluate` on two TUM files, in a process of its own, whose largest memory is told."""
    rng = np.random.default_rng(0)
    stamps = START_NS + STEP_NS * np.arange(POSES)
    p = np.cumsum(rng.normal(0, 0.01, (POSES, 3)), axis=0)
    q = rng.normal([1.0, 0, 0, 0], 0.1, (POSES, 4))
    for name, sigma in (("reference", 0.0), ("estimate", 0.01)):
        noisy = q + rng.normal(0, 1, q.shape) * sigma
        noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
        write_tum(Trajectory(stamps, p + rng.normal(0, 1, p.shape) * sigma, noisy), tmp_path / f"{name}.tum")
    command = [
        sys.executable,
        "-m",
        "uavbench.bench.cli.main",
        "evaluate",
        str(tmp_path / "reference.tum"),
        str(tmp_path / "estimate.tum"),
    ]

    def evaluate() -> None:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert str(POSES) in done.stdout

    benchmark.pedantic(evaluate, rounds=3)
    benchmark.extra_info["largest_memory_mb"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
