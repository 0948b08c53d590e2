"""Two versions of the repository on the same frames, from a git repository made for the test."""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_this_process
from uavbench.bench.cli.main import main
from uavbench.bench.gate.compare import smallest
from uavbench.bench.gate.compare_sides import at_work, statements
from uavbench.bench.gate.versions import placed, version
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.results import Results
from uavbench.trajectories.errors import UserError

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("git") is None, reason="absent: git"),
]
ROOT = Path(__file__).parents[2]
SUITE = """
title = "compare"
seeds = [0, 1, 2, 3, 4]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 1.2 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""
WORSE = "return TrackResult(status='ok', cam_from_world=Pose.exp([0.5, 0.0, 0.0, 0.0, 0.1, 0.0]) @ self.cam_from_world)"


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    folder = tmp_path_factory.mktemp("repository")
    for package in ("bench", "reports", "scenes", "tracker", "trajectories", "src"):
        without = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / package, folder / package, symlinks=True, ignore=without)
    shutil.copy(ROOT / "pyproject.toml", folder)

    def git(*arguments):
        identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True)

    git("init", "-q")
    git("add", "-A")
    git("commit", "-qm", "base")
    git("tag", "base")
    hold = folder / "tracker" / "baselines" / "hold.py"
    text = hold.read_text()
    line = 'return TrackResult(status="ok", cam_from_world=self.cam_from_world)'
    assert line in text
    hold.write_text(text.replace(line, WORSE))
    git("commit", "-qam", "worse")
    (folder / "suite.toml").write_text(SUITE)
    return folder


def compare(repository, monkeypatch, *refs, repeats=2):
    monkeypatch.chdir(repository)
    arguments = ["compare", *refs, "--suite", "suite.toml", "--repeats", str(repeats), "--jobs", "1"]
    arguments += ["--latency-margin", "400%"]
    result = CliRunner().invoke(main, [*arguments, "--resolution", "500%"])
    return result, json.loads((repository / "out/compare/gate/gate.json").read_text()) if result.exit_code in (
        0, 1, 3
    ) else None  # fmt: skip


@pytest.mark.ci
def test_a_version_against_itself_passes_and_against_a_worse_one_fails(repository, monkeypatch):
    result, same = compare(repository, monkeypatch, "base", "base")
    assert result.exit_code == 0, result.output
    errors = {"ATE", "ATE rotation", "RPE 1 s"}
    expected = {"coverage", "latency", *errors, *(f"{name}, typical" for name in errors)}
    assert {f["metric"] for f in same["findings"]} == expected
    assert all(f["change"] == 0 for f in same["findings"] if f["metric"] != "latency")
    result, worse = compare(repository, monkeypatch, "base", ".")
    assert result.exit_code == 1, result.output
    assert "ATE" in {f["metric"] for f in worse["findings"] if f["verdict"] == "fail"}


def test_a_comparison_that_ends_early_leaves_no_scores_of_an_earlier_one(repository, monkeypatch):
    """`uavbench gate` on its two folders gave the earlier comparison's verdict."""
    monkeypatch.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)
    assert compare(repository, monkeypatch, "base", "base", repeats=1)[0].exit_code == 0
    sides = ["gate", "out/compare/head", "--baseline", "out/compare/base", "--latency-margin", "400%"]
    assert "latency" in CliRunner().invoke(main, sides).output

    def ended(*_):
        raise UserError("asked for")

    with monkeypatch.context() as patched:
        patched.setattr("uavbench.bench.gate.compare.at_work", ended)  # before any tracker runs
        assert compare(repository, monkeypatch, "base", ".", repeats=1)[0].exit_code == 2
    judged = CliRunner().invoke(main, sides)
    assert judged.exit_code == 2 and "no scores in it" in judged.output
    assert not (repository / "out/compare/head/timing.json").exists()


OFFSET = """
title = "offset"
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 0.3 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
stream = { kind = "external", command = ["python3", "../programs/stream.py"] }
folder = { kind = "external", command = ["python3", "../programs/folder.py"], mode = "folder" }
plugin = { kind = "my_trackers.off:Off" }
table = { kind = "my_trackers.off:Off", more = 0.0 }
same = { kind = "hold" }
"""
READ = """
import sys, tomllib
from offset import OFF
with open("init.toml", "rb") as file:
    M = tomllib.load(file)["cam_from_model"]
T = [M[i][3] for i in range(3)]
from math import sqrt
def row(stamp):
    w = sqrt(max(0.0, 1 + M[0][0] + M[1][1] + M[2][2])) / 2
    x, y, z = ((M[a][b] - M[b][a]) / (4 * w) for a, b in ((2, 1), (0, 2), (1, 0)))
    n = sqrt(w * w + x * x + y * y + z * z)
    return ",".join(map(repr, [T[0] + OFF, T[1], T[2], w / n, x / n, y / n, z / n]))
"""
STREAM = (
    READ
    + """
print("ready", flush=True)
while line := sys.stdin.buffer.readline():
    words = line.decode().strip().split(",")
    if words[0] == "frame":
        sys.stdin.buffer.read(int(words[2]) * int(words[3]) * int(words[4]))
        print(f"{words[1]},ok,{row(words[1])}", flush=True)
"""
)
FOLDER = (
    READ
    + """
rows = ["stamp_ns,status,px_m,py_m,pz_m,qw,qx,qy,qz"]
for line in open("frames.csv").read().split()[1:]:
    stamp = line.split(",")[0]
    rows.append(f"{stamp},ok,{row(stamp)}")
open("estimates.csv", "w").write("\\n".join(rows) + "\\n")
"""
)
PLUGIN = """
from dataclasses import dataclass
import numpy as np
from my_trackers.helper import OFF
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

@dataclass(frozen=True)
class Off:
    more: float = 0.0
    def start(self, structure, camera, cam_from_world, rng):
        return Run(Pose(np.eye(3), np.array([OFF + self.more, 0.0, 0.0])) @ cam_from_world)

class Run:
    def __init__(self, pose):
        self.pose = pose
    def track(self, image, stamp_ns):
        return TrackResult(status="ok", cam_from_world=self.pose)
"""


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """A repository that holds trackers, their suite and nothing of uavbench; in the working tree all are 30 cm off."""
    files = {
        "suites/offset.toml": OFFSET,
        "programs/stream.py": STREAM,
        "programs/folder.py": FOLDER,
        "programs/offset.py": "OFF = 0.0\n",
        "source/my_trackers/__init__.py": "",
        "source/my_trackers/off.py": PLUGIN,
        "source/my_trackers/helper.py": "OFF = 0.0\n",
        "tracker.py": "raise RuntimeError('not this one')\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "source")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["source", str(ROOT)]))
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "-A")
    git(tmp_path, "commit", "-qm", "base")
    yield tmp_path
    for name in [name for name in sys.modules if name.split(".")[0] == "my_trackers"]:
        del sys.modules[name]


def git(folder, *arguments):
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True)


def off(folder, side, label):
    """How far along the camera's x a side's first pose is from the ground truth, m."""
    results = Results.load(folder / "out/compare" / side / "results/box-s0" / f"{label}@15hz")
    sequence = Sequence.load(folder / "out/compare/head/sequences/box-s0")
    return float((results.rows[0].cam_from_world @ sequence.true_cam_from_world(0).inverse()).translation[0])


@pytest.mark.ci
def test_all_of_a_version_comes_from_its_own_tree(foreign):
    (foreign / "programs/offset.py").write_text("OFF = 0.3\n")
    (foreign / "source/my_trackers/helper.py").write_text("OFF = 0.3\n")
    suite = foreign / "suites/offset.toml"
    suite.write_text(suite.read_text().replace("more = 0.0", "more = 0.2") + 'new = { kind = "hold" }\n')
    (foreign / "notes.txt").write_text("not in git")
    arguments = ["compare", "HEAD", "--suite", "suites/offset.toml", "--repeats", "1", "--jobs", "1"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code in (1, 3), result.output
    moved = {label: (off(foreign, "base", label), off(foreign, "head", label)) for label in LABELS}
    expected = {"same": (0, 0), "table": (0, 0.5), "stream": (0, 0.3), "folder": (0, 0.3), "plugin": (0, 0.3)}
    assert {label: pytest.approx(pair, abs=1e-9) for label, pair in expected.items()} == moved
    assert "not compared, unknown to the base: new" in result.output
    assert "same on both sides: notes.txt" in result.output
    git(foreign, "commit", "-qam", "worse")
    result = CliRunner().invoke(main, ["compare", "HEAD~1", "HEAD", *arguments[2:]])
    assert result.exit_code in (1, 3), result.output
    assert {label: (off(foreign, "base", label), off(foreign, "head", label)) for label in LABELS} == moved


LABELS = ("same", "table", "stream", "folder", "plugin")


@pytest.mark.ci
def test_what_a_program_imports_from_an_editable_install_is_that_of_each_version(foreign):
    venv.create(foreign / ".venv", symlinks=True)
    site = next((foreign / ".venv").glob("lib/python*/site-packages"))
    (site / "installed.pth").write_text(str(foreign / "installed") + "\n")
    for name, text in {"my_stream.py": STREAM.replace("offset", "shift"), "shift.py": "OFF = 0.0\n"}.items():
        (foreign / "installed").mkdir(exist_ok=True)
        (foreign / "installed" / name).write_text(text)
    (foreign / "programs/start.py").write_text("import my_stream\n")
    trackers = """
    script = { kind = "external", command = ["../.venv/bin/python", "../programs/start.py"] }
    module = { kind = "external", command = ["../.venv/bin/python", "-m", "my_stream"] }
    """
    (foreign / "suites/offset.toml").write_text(OFFSET.partition("[trackers]")[0] + "[trackers]" + trackers)
    git(foreign, "add", "installed", "programs", "suites")
    git(foreign, "commit", "-qm", "install")
    (foreign / "installed/shift.py").write_text("OFF = 0.3\n")
    git(foreign, "commit", "-qam", "worse")
    arguments = ["--suite", "suites/offset.toml", "--repeats", "1", "--jobs", "1"]
    for refs in (("HEAD~1", "HEAD"), ("HEAD~1",)):
        result = CliRunner().invoke(main, ["compare", *refs, *arguments])
        assert result.exit_code in (1, 3), result.output
        assert "nothing of its program" not in result.output
        for label in ("script", "module"):
            assert off(foreign, "base", label) == pytest.approx(0.0, abs=1e-9)
            assert off(foreign, "head", label) == pytest.approx(0.3, abs=1e-9)


def test_what_the_base_lacks_and_what_is_not_in_git_is_told(foreign, tmp_path_factory):
    with version("HEAD") as base:
        (foreign / "programs/later.py").write_text("print('later')")
        git(foreign, "add", "programs/later.py")
        later = {"kind": "external", "command": ["python3", "later.py"]}
        assert placed(base, later, foreign / "programs").missing == ("programs/later.py",)
        with pytest.raises(UserError, match=r"absent\.toml"), at_work(base, foreign / "suites/absent.toml", []):
            pass
    (foreign / "suites/new.toml").write_text(OFFSET)
    git(foreign, "add", "suites/new.toml")
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "offset.toml"
    program = foreign / "programs" / "stream.py"
    elsewhere.write_text(OFFSET.replace("../programs/stream.py", str(program)))
    with version("HEAD") as base:
        with at_work(base, foreign / "suites/new.toml", ["stream"]) as side:
            assert side.tables["stream"]["command"][1] == str(base.folder / "programs/stream.py")
            assert next(iter(statements({"base": side}, foreign / "suites/new.toml"))).endswith("of the working tree")
        with at_work(base, elsewhere, ["stream", "folder"]) as side:
            assert side.tables["stream"]["command"][1] == str(base.folder / "programs/stream.py")
            told = list(statements({"base": side}, elsewhere))
            assert any("lies outside of the repository" in line for line in told)
            assert any(line.startswith("folder: nothing of its program") for line in told)


def test_a_version_holds_links_that_lead_out_of_the_repository(foreign, tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    (foreign / "data").symlink_to(data)
    (foreign / "above").symlink_to("../above")
    git(foreign, "add", "data", "above")
    git(foreign, "commit", "-qm", "links")
    with version("HEAD") as base:
        assert (base.folder / "data").readlink() == data
        assert str((base.folder / "above").readlink()) == "../above"
        assert (base.folder / "programs/offset.py").read_text() == "OFF = 0.0\n"


def state_of(folder):
    """All that git keeps in a repository, by file."""
    return {path: path.read_bytes() for path in sorted((folder / ".git").rglob("*")) if path.is_file()}


def test_a_version_holds_all_tracked_files_whatever_their_attributes(foreign, monkeypatch):
    """Of those with export-ignore it had none."""
    attributes = "programs export-ignore\nnotes.txt export-subst\n.gitattributes export-ignore\n*.crlf eol=crlf\n"
    (foreign / ".gitattributes").write_text(attributes)
    (foreign / "notes.txt").write_text("$Format:%H$\n")
    (foreign / "rows.crlf").write_text("1\n2\n")
    (foreign / "programs/stream.py").chmod(0o755)
    git(foreign, "add", "-A")
    git(foreign, "commit", "-qm", "attributes")
    (foreign / "staged.txt").write_text("not committed")
    git(foreign, "add", "staged.txt")
    for name, value in {"sparseCheckout": "true", "splitIndex": "true", "untrackedCache": "true"}.items():
        git(foreign, "config", f"core.{name}", value)
    (foreign / ".git/info/sparse-checkout").write_text("/suites/\n")
    (foreign / ".git/hooks/post-index-change").write_text("#!/bin/sh\ntouch .git/ran\n")
    (foreign / ".git/hooks/post-index-change").chmod(0o755)
    monkeypatch.setenv("GIT_INDEX_FILE", str(foreign / ".git/index"))
    before = state_of(foreign)
    with version("HEAD") as base:
        listed = subprocess.run(["git", "ls-tree", "-r", "--name-only", "HEAD"], capture_output=True, text=True)
        assert {name for name in listed.stdout.split() if not (base.folder / name).is_file()} == set()
        assert (base.folder / "notes.txt").read_text() == "$Format:%H$\n"
        assert (base.folder / "rows.crlf").read_bytes() == b"1\r\n2\r\n"
        assert os.access(base.folder / "programs/stream.py", os.X_OK)
        assert not (base.folder / "staged.txt").exists()
        assert not os.access(base.folder / "programs/offset.py", os.X_OK)
        assert [str(name) for name in base.linked] == []
    assert not base.folder.parent.exists()
    assert state_of(foreign) == before


def test_a_version_of_a_linked_working_tree_has_empty_folders_for_submodules(foreign, tmp_path_factory, monkeypatch):
    other = tmp_path_factory.mktemp("other")
    git(other, "init", "-q")
    git(other, "commit", "-qm", "first", "--allow-empty")
    git(foreign, "-c", "protocol.file.allow=always", "submodule", "add", "-q", str(other), "inner")
    git(foreign, "commit", "-qm", "submodule")
    git(foreign, "config", "submodule.recurse", "true")
    linked = tmp_path_factory.mktemp("linked") / "tree"
    git(foreign, "worktree", "add", "-q", str(linked), "-b", "linked")
    monkeypatch.chdir(linked)
    before = state_of(foreign)
    with version("HEAD") as base:
        assert base.top == linked
        assert list((base.folder / "inner").iterdir()) == []
        assert (base.folder / "programs/offset.py").read_text() == "OFF = 0.0\n"
    assert state_of(foreign) == before


def test_a_ref_that_is_none_is_a_users_mistake(repository, monkeypatch):
    result, _ = compare(repository, monkeypatch, "no-such-ref", ".")
    assert result.exit_code == 2
    assert "'no-such-ref' is no commit of this repository" in result.output


def test_of_each_frame_the_smallest_time_counts():
    times = {
        ("t", "t@15hz", "box-s3", 3, "base"): [[1.0, 9.0, 3.0], [2.0, 2.0, 3.0]],
        ("t", "t@15hz", "box-s3", 3, "head"): [[4.0, 4.0, 4.0], [5.0, 3.0, 9.0]],
    }
    assert smallest(times, ["t"]) == {"t@15hz": [{"sequence": "box", "seed": 3, "base_ms": 2.0, "head_ms": 4.0}]}
    assert smallest(times, []) == {}
    quick = {key: [[0.001]] for key in times}
    assert smallest(quick, ["t"])["t@15hz"][0]["head_ms"] == 0.05


def test_frames_that_a_program_lost_do_not_hide_the_latency_of_the_others():
    nan = float("nan")
    base = [[10.0, nan, 20.0, 30.0], [11.0, 9.0, 18.0, nan]]
    head = [[20.0, 19.0, nan, 40.0], [21.0, 50.0, nan, 60.0]]
    times = {("t", "t@15hz", "box-s3", 3, "base"): base, ("t", "t@15hz", "box-s3", 3, "head"): head}
    # frames 0, 1 and 3 are timed on both sides: 10, 9, 30 and 20, 19, 40
    assert smallest(times, ["t"]) == {"t@15hz": [{"sequence": "box", "seed": 3, "base_ms": 10.0, "head_ms": 20.0}]}
    untimed = {key: [[nan] * 4] * 2 for key in times}
    assert smallest(untimed, ["t"]) == {}


@pytest.mark.ci
def test_a_tracker_of_the_working_tree_that_is_edited_meanwhile_is_not_compared(foreign):
    program = foreign / "programs/stream.py"
    program.write_text(STREAM.replace('print("ready"', 'open(__file__, "a").write("#")\nprint("ready"'))
    suite = foreign / "suites/offset.toml"
    result = CliRunner().invoke(main, ["compare", "HEAD", "--suite", str(suite), "--repeats", "1", "--jobs", "1"])
    assert result.exit_code == 2
    assert "changed while it was compared: stream.py" in result.output
    assert not (foreign / "out/compare/gate").exists()
