"""Every file that a job opens is in its key, is an output of what it needs, or belongs to what is installed."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.bench.test_external import HOLD, STREAM
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.model_files.cao.writing import write_cao

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
TRIAL = ROOT / "bench" / "trial" / "sequence"
TRACE = """
import os
import sys
from pathlib import Path

HERE = Path(__file__).parent

def opened(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)) and not trace.busy:
        trace.busy = True
        try:
            path = arguments[0] if isinstance(arguments[0], str) else arguments[0].decode()
            job = (HERE / "job").read_text() if (HERE / "job").exists() else ""
            with (HERE / "opened.txt").open("a") as log:
                place = os.path.abspath(path)  # without `..`: numba names sources relative to the current folder
                log.write(f"{job}\\t{arguments[1]}\\t{place}\\n")
        finally:
            trace.busy = False

class trace:
    busy = False

sys.addaudithook(opened)
"""
DRIVE = """
import json, sys
from pathlib import Path
from uavbench.bench.config.suite import load_suite
from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.jobs import plan
from uavbench.trajectories.sources import digests

keyed = set()
digest = digests._digest
digests._digest = lambda path, stamp: (keyed.add(str(path.absolute())), digest(path, stamp))[1]

def entering(*values):
    keyed.clear()
    content_hash(*values)
    return sorted(keyed)

here, out = Path(sys.argv[1]), Path(sys.argv[2])
suite = load_suite(Path(sys.argv[3]))
keys = {}
for job in plan(suite, out):
    work = job.work
    (here / "job").write_text("")
    track = getattr(work, "track", work)
    parts = [work.spec] if job.verb == "render" else [track.tracker, track.start] if job.verb == "track" else []
    keys[job.name] = [entering(*parts), [need.name for need in job.needs], job.verb]
    (here / "job").write_text(job.name)
    work(job.content_hash, lambda done, total: None)
(here / "job").write_text("")
(here / "keys.json").write_text(json.dumps(keys))
"""
RENDERED = """
title = "opened"
rates_hz = [15.0]
protocols = ["reset"]
[sequences.mine]
structure = { kind = "mesh", path = "house.obj" }
environment = { kind = "indoor" }
flight.path = { kind = "waypoints", file = "way.csv" }
flight.airframe = { kind = "file", path = "vehicle.toml" }
camera = { width = 96, height = 72, horizontal_fov_deg = 65.0 }
[trackers]
plugin = { kind = "opened_plugin:Mine" }
program = { kind = "external", command = ["python3", "program.py"] }
"""
RECORDED = """
title = "opened"
rates_hz = [15.0]
[recordings.mine]
rate_hz = 15.0
[recordings.mine.source]
kind = "files"
images_path = "images"
model_file = "model.cao"
camera_file = "camera.toml"
init_file = "init.toml"
[trackers]
hold = { kind = "hold" }
"""
PLUGIN = """
from dataclasses import dataclass
from pathlib import Path
import opened_helper
from uavbench.tracker.protocol import TrackResult

@dataclass(frozen=True)
class Mine:
    def start(self, structure, camera, cam_from_world, rng):
        import opened_late
        (Path(__file__).parent / "weights.txt").read_text()
        self = Run()
        self.pose = cam_from_world
        return self

class Run:
    def track(self, image, stamp_ns):
        return TrackResult(status="ok", cam_from_world=self.pose)
"""
PROGRAM = f"""
from pathlib import Path
import opened_beside
(Path(__file__).parent / "net.txt").read_text()
{HOLD}{STREAM.format(each="pass")}"""
"""It holds its first pose, which the short flight leaves it: `reset` starts one that is lost anew at every frame."""
HOUSE = """mtllib house.mtl
v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 2\nv 1 -1 2\nv 1 1 2\nv -1 1 2
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl brick
f 1/1 3/3 2/2\nf 1/1 4/4 3/3\nf 5/1 6/2 7/3\nf 5/1 7/3 8/4
f 1/1 2/2 6/3\nf 1/1 6/3 5/4\nf 2/1 3/2 7/3\nf 2/1 7/3 6/4
f 3/1 4/2 8/3\nf 3/1 8/3 7/4\nf 4/1 1/2 5/3\nf 4/1 5/3 8/4
"""
PACKAGES = {
    "render": {"trajectories", "scenes", "tracker"},
    "track": {"trajectories", "scenes", "tracker", "reports"},
    "score": {"trajectories", "scenes", "tracker", "reports"},
    "report": {"trajectories", "scenes", "tracker", "reports"},
}
"""Packages whose code enters the key of a job, with those of the jobs that it needs."""


def rendered(folder):
    (folder / "house.obj").write_text(HOUSE)
    (folder / "house.mtl").write_text("newmtl brick\nmap_Kd brick.png\n")
    cv2.imwrite(str(folder / "brick.png"), np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8))
    (folder / "way.csv").write_text("x_m,y_m,z_m,yaw_deg\n-4,0,1,0\n-3.9,0,1,0\n")
    (folder / "vehicle.toml").write_text('like = "crazyflie"\n')
    for name, text in {"opened_plugin": PLUGIN, "opened_helper": "", "opened_late": "", "program": PROGRAM}.items():
        (folder / f"{name}.py").write_text(text)
    for name in ("opened_beside.py", "weights.txt", "net.txt"):
        (folder / name).write_text("")
    return RENDERED


def recorded(folder):
    shutil.copytree(TRIAL / "frames", folder / "images")
    shutil.copy(TRIAL / "camera.toml", folder)
    sequence = Sequence.load(TRIAL)
    (folder / "parts").mkdir()
    write_cao(sequence.structure, folder / "parts" / "box.cao")
    (folder / "model.cao").write_text('V1\nload("parts/box.cao")\n0\n0\n0\n0\n0\n0\n')
    rows = sequence.true_cam_from_world(0).matrix.tolist()
    (folder / "init.toml").write_text(f"cam_from_model = {rows!r}\n")
    return RECORDED


def source(path):
    """The source of a compiled module, the path itself of any other file."""
    return path.parents[1] / f"{path.name.split('.')[0]}.py" if path.parent.name == "__pycache__" else path


def allowed(path, verb, keyed, folders):
    """Whether a job may open a file without a change of it being seen."""
    if str(path) in keyed or any(path.is_relative_to(folder) for folder in folders):
        return True
    if path.parent == ROOT / "src" / "uavbench.egg-info":  # of the installation in place; the code has its hash
        return True
    if path == ROOT / "src" / "uavbench" / "__init__.py":  # names for scripts, which the keys of kernels cover
        return True
    for root in (ROOT / "src" / "uavbench", ROOT):
        if not path.is_relative_to(root):
            continue
        package = path.relative_to(root).parts[0]
        return package in PACKAGES[verb] or (package == "bench" and path.suffix == ".py")
    return False


@pytest.mark.parametrize("kind", [rendered, recorded])
def test_every_file_that_a_job_opens_is_in_its_key(tmp_path, kind):
    suite, here, out = (tmp_path / name for name in ("suite", "here", "out"))
    for folder in (suite, here, out, tmp_path / "tmp", tmp_path / "home"):
        folder.mkdir()
    (suite / "suite.toml").write_text(kind(suite))
    (here / "sitecustomize.py").write_text(TRACE)
    (here / "drive.py").write_text(DRIVE)
    own = {"HOME": "home", "TMPDIR": "tmp"}
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")  # compiled kernels have keys of their own
    environment = {
        **{k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")},
        "XDG_CACHE_HOME": str(caches),
        **{name: str(tmp_path / place) for name, place in own.items()},
        "PYTHONPATH": os.pathsep.join(map(str, (here, suite, ROOT / "src", ROOT))),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, str(here / "drive.py"), str(here), str(out), str(suite / "suite.toml")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    keys = json.loads((here / "keys.json").read_text())
    installed = [
        Path(place) for place in (sys.prefix, sys.base_prefix, "/usr", "/lib", "/etc", "/proc", "/sys", "/dev")
    ]
    opened = {}
    for line in (here / "opened.txt").read_text().splitlines():
        job, _, path = line.split("\t")
        opened.setdefault(job, set()).add(source(Path(path)))

    def keyed(job):
        files, needs, _ = keys[job]
        return {*files, *(file for need in needs for file in keyed(need))}

    everywhere = [*installed, here, out, tmp_path / "tmp", tmp_path / "home", caches]
    for job, (_, _, verb) in keys.items():
        unseen = [
            path for path in opened.get(job, ()) if path.is_file() and not allowed(path, verb, keyed(job), everywhere)
        ]
        assert unseen == [], job
    given = {path for paths in opened.values() for path in paths if path.is_relative_to(suite) and path.is_file()}
    every = {Path(path) for job in keys for path in keyed(job)}
    assert given - {suite / "suite.toml"} <= every
    files = {source(path) for path in suite.rglob("*") if path.is_file()} - {suite / "suite.toml"}
    assert files - given <= {path for path in files if path.suffix == ".png"}  # OpenCV opens images out of sight
    assert files <= every
