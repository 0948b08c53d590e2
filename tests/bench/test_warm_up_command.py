"""`uavbench warm-up` compiles every kernel that there is."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

from uavbench.trajectories.kernels.compiled import KERNELS

ROOT = Path(__file__).parents[2]
ROOMS = ("bench", "reports", "scenes", "tracker", "trajectories")


def test_it_compiles_every_kernel_of_the_source():
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            if "@compiled" in path.read_text(encoding="utf-8"):
                import_module(".".join(["uavbench", *path.relative_to(ROOT).with_suffix("").parts]))
    command = [sys.executable, "-m", "uavbench.bench.cli", "warm-up"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    own = [kernel for kernel in KERNELS if kernel.py_func.__module__.startswith("uavbench.")]
    assert said == f"{len(own)} kernels are compiled\n"
