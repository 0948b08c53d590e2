"""`uavbench warm-up` compiles every kernel that there is, but those of benchmarks."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

from uavbench.trajectories.kernels.compiled import KERNELS

ROOT = Path(__file__).parents[2]
ROOMS = ("bench", "reports", "scenes", "tracker", "trajectories")
OF_BENCHMARKS = ROOT / "bench" / "speed"
"""No command imports what draws the images of benchmarks and tests."""


def test_it_compiles_every_kernel_of_the_source():
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            if path.parent != OF_BENCHMARKS and "@compiled" in path.read_text(encoding="utf-8"):
                import_module(".".join(["uavbench", *path.relative_to(ROOT).with_suffix("").parts]))
    command = [sys.executable, "-m", "uavbench.bench.cli", "warm-up"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    modules = [kernel.py_func.__module__ for kernel in KERNELS]
    own = [each for each in modules if each.startswith("uavbench.") and not each.startswith("uavbench.bench.speed.")]
    assert said == f"{len(own)} kernels are compiled\n"
