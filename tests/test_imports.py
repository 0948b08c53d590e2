"""The five packages are ours wherever they are imported from, and the tracker stays light."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def python(code, folder):
    run = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_the_packages_are_ours_from_a_foreign_folder(tmp_path):
    code = "from uavbench import bench, scenes, trajectories, tracker, reports as r\n"
    code += "print(*[m.__file__ for m in (bench, scenes, trajectories, tracker, r)], sep='\\n')"
    for line in python(code, tmp_path).split():
        assert Path(line).is_relative_to(ROOT)


def test_the_tracker_does_not_load_what_a_vehicle_does_not_have(tmp_path):
    code = "import sys, uavbench.tracker.registry, uavbench.tracker.run\n"
    code += "print(*sorted({m.split('.')[0] for m in sys.modules}))"
    loaded = set(python(code, tmp_path).split())
    assert not loaded & {"pyrender", "OpenGL", "mujoco", "pandas", "matplotlib", "trimesh", "pydantic", "click"}
