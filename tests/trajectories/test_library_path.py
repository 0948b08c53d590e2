"""Nothing that the program starts looks for its libraries in the current folder because OpenCV was imported."""

import os
import subprocess
import sys

import pytest

TELL = "import os; print(os.environ.get('LD_LIBRARY_PATH'))"
IMPORTS = ["import uavbench; import cv2", "import cv2; import uavbench", "import uavbench.scenes.image_files"]
POOL = """
import os
from uavbench.bench.runner.executors import SpawnPool
if __name__ == "__main__":
    with SpawnPool(1) as pool:
        print(pool.submit(os.getenv, "LD_LIBRARY_PATH").result())
"""
KEY = "import uavbench, cv2; from uavbench.bench.inputs.content_hash import code_hash; print(code_hash())"


def said(code, folder, path=None):
    """What a process of its own prints in a folder."""
    environment = {name: value for name, value in os.environ.items() if name != "LD_LIBRARY_PATH"}
    environment |= {} if path is None else {"LD_LIBRARY_PATH": path}
    script = folder / "script.py"
    script.write_text(code)
    done = subprocess.run(
        [sys.executable, "-P", script], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.mark.parametrize("imports", IMPORTS)
@pytest.mark.parametrize("path", [None, "/opt/lib", "/opt/lib:/opt/more"])
def test_importing_opencv_leaves_the_library_path_as_it_is(tmp_path, imports, path):
    left = said(f"{imports}\n{TELL}", tmp_path, path)
    assert "" not in left.split(":")
    if imports != IMPORTS[1]:  # there OpenCV's own folder stays
        assert left == str(path)


def test_opencv_is_whole(tmp_path):
    code = "import uavbench, cv2, cv2.aruco, importlib; print(cv2.imencode('.png', __import__('numpy').eye(3))[0])"
    assert said(code, tmp_path) == "True"


def test_a_worker_has_the_library_path_of_its_user(tmp_path):
    assert said(POOL, tmp_path) == "None"
    assert said(POOL, tmp_path, "/opt/lib") == "/opt/lib"


def test_libraries_in_the_current_folder_are_in_no_key(tmp_path):
    keys = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "libGL.so.1").write_text(name)
        keys.append(said(KEY, tmp_path / name))
    assert keys[0] == keys[1]
