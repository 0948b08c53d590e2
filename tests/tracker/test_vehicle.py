"""The example of the page on vehicles, as it stands there, in a process of its own: what it says, and what it loads."""

import shutil
import subprocess
import sys

import pytest

from tests.docs.pages import ROOT, blocks
from uavbench.scenes.dataset.sequence import Sequence

TRIAL = ROOT / "bench" / "trial" / "sequence"
FOREIGN = ("pyrender", "OpenGL", "mujoco", "pandas", "matplotlib", "trimesh", "pydantic", "bench", "reports")
LOADED = f"""
import sys
print("loaded", *sorted({{name.split(".")[0] for name in sys.modules}} & set({FOREIGN!r})))
"""


@pytest.fixture
def saved(tmp_path):
    """Folder with the page's files and the trial's frames; the text of the example."""
    page = {block.file: block.text for block in blocks(ROOT / "docs" / "my-vehicle.md") if block.file}
    for name, text in page.items():
        (tmp_path / name).write_text(text + LOADED * (name == "vehicle.py"))
    (tmp_path / "vehicle").mkdir()
    shutil.copytree(TRIAL / "frames", tmp_path / "vehicle" / "frames")
    shutil.copy(TRIAL / "camera.toml", tmp_path / "vehicle")
    return tmp_path, page["vehicle.py"]


def run(folder, *words):
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_example_goes_from_frames_to_poses_and_loads_no_renderer(saved):
    folder, text = saved
    assert len([line for line in text.splitlines() if line]) <= 15
    run(folder, "prepare.py", str(TRIAL / "model.obj"))
    *said, loaded = run(folder, "vehicle.py")
    assert loaded.split() == ["loaded"]
    assert len(said) == len(list((folder / "vehicle" / "frames").iterdir()))
    status, *at = said[0].split()
    assert status == "ok"
    ground_truth = Sequence.load(TRIAL).ground_truth.positions_m[0]
    assert [float(v) for v in at] == pytest.approx(ground_truth.tolist(), abs=0.1)
