"""A job is done again when an input changed that only its run shows, and never because of what it did itself."""

import importlib
import json
import os
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from tests.bench.conftest import in_this_process
from tests.bench.small_suites import recorded_suite
from uavbench.bench.config.suite import load_suite
from uavbench.bench.inputs.observed import looks
from uavbench.bench.inputs.observed.seen_inputs import CHANGED, SeenInputs
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.commands import ExecutionOptions, bring_up_to
from uavbench.bench.runner.graph import Job, run_graph, run_job
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.written_files import Record

IMPORTS = """
import ctypes, glob, importlib, os, sqlite3, subprocess, sys, tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
HERE = Path(__file__).parent
FAR = HERE.parent / "far"
"""


@pytest.fixture(autouse=True)
def apart(monkeypatch):
    """The path and the modules of the process are as before; looks are noted."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    modules = {*sys.modules}
    looks.watch()
    yield
    for name in {*sys.modules} - modules:
        del sys.modules[name]


@pytest.fixture
def far(tmp_path):
    """Folder of inputs that no text names."""
    (tmp_path / "far" / "sub").mkdir(parents=True)
    (tmp_path / "here").mkdir()
    for name in ("a.txt", "b.txt", "sub/c.txt"):
        (tmp_path / "far" / name).write_text("1")
    return tmp_path / "far"


def job_of(root, name, reads):
    """A job that calls `read` of a user's module, whose source alone is in its key."""
    source = root.parent / "here" / f"{name}.py"
    if not source.exists():
        source.write_text(f"{IMPORTS}{reads}")
    if str(source.parent) not in sys.path:
        sys.path.insert(0, str(source.parent))
    marker = root / f"{name}.json"

    def work(content_hash, on_step):
        importlib.import_module(name).read()
        marker.write_text(json.dumps({"content_hash": content_hash}))

    return Job(
        verb="track", name=name, work=work, marker=marker, root=root, content_hash="x",
        keyed=frozenset({source}),
    )  # fmt: skip


def done(job):
    """The job, after its worker did it."""
    run_job(Plugins(), job.name, job.work, job.made, (), job.keyed)
    return job


def program(folder, value):
    (folder / "x.c").write_text(f"int v(void) {{ return {value}; }}")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", folder / "libx.so", folder / "x.c"], check=True)


def database(folder, value):
    with sqlite3.connect(folder / "x.db") as data:
        data.executescript(f"drop table if exists t; create table t (v); insert into t values ({value})")
    data.close()


def linked_to(name):
    def link(folder):
        (folder / "link").unlink(missing_ok=True)
        (folder / "sub" / "c.txt").write_text("2")
        (folder / "link").symlink_to(folder / name)

    return link


def text(name, content):
    return lambda folder: (folder / name).write_text(content)


def nothing(folder):
    pass


LISTS = "def read(): os.listdir(FAR)"
GLOBS = "def read(): [*FAR.glob('*.t' + 'xt')]"
IMPORTED = "def read():\n    sys.path.insert(0, str(FAR))\n    importlib.import_module('hid' + 'den')"
HIDDEN, READS = (
    text("hidden.py", "V = 1"),
    "from pathlib import Path\n(Path(__file__).parent / ('a.' + 'txt')).read_text()",
)
C = "def read(): subprocess.run([sys.executable, '-c', 'import hidden'], cwd=FAR, check=True)"
M = "def read(): subprocess.run([sys.executable, '-m', 'hidden'], env={'PYTHONPATH': str(FAR)}, check=True)"
SCRIPT = "def read(): subprocess.run(['sh', 'run.' + 'sh'], cwd=FAR, check=True, stdout=subprocess.DEVNULL)"
THREAD = "def read():\n    with ThreadPoolExecutor() as pool: [*pool.map(open, [FAR / ('a.' + 'txt')])]"
AT_IMPORT = "(FAR / ('a.' + 'txt')).read_text()\ndef read(): pass"
DATABASE = "def read(): sqlite3.connect(FAR / ('x.' + 'db')).close()"
CASES = {
    "a file that is read": (nothing, "def read(): open(FAR / os.environ['N'])", text("a.txt", "2")),
    "a file that vanishes": (nothing, "def read(): open(FAR / os.environ['N'])", lambda far: (far / "a.txt").unlink()),
    "a file that appears": (nothing, "def read():\n    try: open(FAR / 'x')\n    except OSError: pass", text("x", "1")),
    "a file of a listed folder, that a library opens": (nothing, LISTS, text("b.txt", "2")),
    "a file that joins a listed folder": (nothing, LISTS, text("d.txt", "1")),
    "a file that leaves a folder": (nothing, "def read(): [*FAR.iterdir()]", lambda far: (far / "b.txt").unlink()),
    "a file of a walked folder": (nothing, "def read(): [*os.walk(FAR)]", text("sub/d.txt", "1")),
    "a file that fits a pattern": (nothing, GLOBS, text("d.txt", "1")),
    "a file below that fits": (nothing, GLOBS.replace("glob", "rglob"), text("sub/d.txt", "1")),
    "a file that fits a text": (nothing, "def read(): glob.glob(f'{FAR}/*/*.t' + 'xt')", text("sub/d.txt", "1")),
    "a module of a folder that is put on the path": (HIDDEN, IMPORTED, text("hidden.py", "V = 2")),
    "a file that such a module reads": (text("hidden.py", READS), IMPORTED, text("a.txt", "2")),
    "what python -c imports": (HIDDEN, C, text("hidden.py", "V = 2")),
    "what python -m imports": (HIDDEN, M, text("hidden.py", "V = 2")),
    "a file that a started script names": (text("run.sh", "cat a.txt"), SCRIPT, text("a.txt", "2")),
    "a script of a shell": (text("x.sh", "true"), "def read(): os.system(f'sh {FAR}/x.' + 'sh')", text("x.sh", ":")),
    "a database": (partial(database, value=1), DATABASE, partial(database, value=2)),
    "a link that is set anew": (linked_to("a.txt"), "def read(): open(FAR / ('li' + 'nk'))", linked_to("sub/c.txt")),
    "a file that a thread reads": (nothing, THREAD, text("a.txt", "2")),
    "a file that is read while a module is imported": (nothing, AT_IMPORT, text("a.txt", "2")),
}
"""What is done before a job, the module whose `read` it calls, and the change after it."""


@pytest.mark.parametrize("case", CASES)
def test_a_change_of_what_only_the_run_shows_makes_the_job_stale(tmp_path, far, monkeypatch, case):
    before, reads, change = CASES[case]
    monkeypatch.setenv("N", "a.txt")
    before(far)
    job = done(job_of(tmp_path / "out", "mine", reads))
    assert job.fresh
    change(far)
    assert not job.fresh


def test_a_compiled_library_that_changes_makes_the_job_stale(tmp_path, far):
    program(far, 1)
    job = done(job_of(tmp_path / "out", "mine", "def read(): ctypes.CDLL(str(FAR / ('lib' + 'x.so'))).v()"))
    assert job.fresh
    program(far, 2)
    assert not job.fresh


SAME = {
    "a log": "def read():\n    with open(FAR / 'x.log', 'a') as log: log.write('1')",
    "a cache": "def read():\n    path = FAR / 'x.bin'\n    path.exists() or path.write_text('1')\n    path.read_text()",
    "a cache that is moved to its place": (
        "def read():\n    (FAR / 'new').write_text('1')\n    os.replace(FAR / 'new', FAR / 'x')\n    open(FAR / 'x')"
    ),
    "a temporary file": "def read():\n    with tempfile.NamedTemporaryFile() as file: open(file.name).read()",
    "files of the system": "def read(): [open(name) for name in (os.devnull, '/proc/self/stat', '/etc/hostname')]",
    "a log in a folder that it lists": (
        "def read():\n    with open(FAR / 'x.log', 'a') as log: log.write('1')\n    [*FAR.iterdir()]"
    ),
    "a folder in one that it lists": "def read():\n    (FAR / 'x').mkdir(exist_ok=True)\n    [*FAR.iterdir()]",
    "a program's output": (
        "def read():\n    subprocess.run(['sh', '-c', 'sleep 0.02; date +%N > x'], cwd=FAR)\n    open(FAR / 'x')"
    ),
    "the suite's folder": "def read(): [p.read_text() for p in (HERE.parent / 'out').rglob('*') if p.is_file()]",
    "a file among temporary ones": "def read(): open(os.path.join(tempfile.gettempdir(), 'x')).read()",
    "a user's cache": "def read(): open(os.path.join(os.environ['XDG_CACHE_HOME'], 'x')).read()",
}


@pytest.mark.parametrize("case", SAME)
def test_what_a_job_does_itself_leaves_it_fresh(tmp_path, far, monkeypatch, case):
    places = [tmp_path / "cache", tmp_path / "temporary"]
    monkeypatch.setenv("XDG_CACHE_HOME", str(places[0]))
    monkeypatch.setattr("tempfile.tempdir", str(places[1]))
    for place in (*places, tmp_path / "out"):
        place.mkdir()
        (place / "x").write_text("1")
    jobs = [job_of(tmp_path / "out", name, SAME[case]) for name in ("one", "two")]
    for job in (*jobs, *jobs):
        done(job)
    for place in (*places, tmp_path / "out"):
        (place / "x").write_text("2")
    assert all(job.fresh for job in jobs)


def test_times_compiled_code_hidden_files_and_other_files_do_not_count(tmp_path, far):
    job = done(job_of(tmp_path / "out", "mine", "def read(): [open(p) for p in FAR.glob('*.t' + 'xt')]"))
    os.utime(far / "a.txt", (1, 1))
    (far / "__pycache__").mkdir()
    for name in ("__pycache__/x.txt", ".x.txt", "notes.md"):
        (far / name).write_text("1")
    assert job.fresh


def test_a_pipe_is_not_waited_for(tmp_path, far):
    os.mkfifo(far / "pipe")
    reads = "def read(): os.close(os.open(FAR / ('pi' + 'pe'), os.O_RDONLY | os.O_NONBLOCK))"
    assert done(job_of(tmp_path / "out", "mine", reads)).fresh


def test_a_listed_folder_of_sources_counts_by_its_names_alone(tmp_path, far):
    """Editing a suite or another plug-in beside it is no reason to run a plug-in again."""
    (tmp_path / "here" / "suite.toml").write_text("1")
    job = done(job_of(tmp_path / "out", "mine", "def read(): os.listdir(HERE)"))
    (tmp_path / "here" / "suite.toml").write_text("2")
    assert job.fresh
    (tmp_path / "here" / "net.bin").write_text("2")
    assert not job.fresh


def test_a_file_of_the_key_is_no_input_of_another_job_by_the_same_helper(tmp_path, far):
    (tmp_path / "here" / "helper.py").write_text("def load(path): return path.read_text()\n")
    given = "import helper\ndef read(): helper.load(FAR / '{}')"
    first, second = (job_of(tmp_path / "out", n, given.format(f)) for n, f in (("one", "a.txt"), ("two", "b.txt")))
    helper = tmp_path / "here" / "helper.py"
    run_job(Plugins(), "one", first.work, first.made, (), first.keyed | {helper, far / "a.txt"})
    run_job(Plugins(), "two", second.work, second.made, (), second.keyed | {helper, far / "b.txt"})
    (far / "a.txt").write_text("2")
    assert second.fresh


def test_what_a_helper_keeps_for_the_whole_process_counts_for_each_job_that_uses_it(tmp_path, far):
    helper = tmp_path / "here" / "helper.py"
    helper.write_text("from functools import cache\n@cache\ndef load(path): return path.read_text()\n")
    given = "import helper\ndef read(): helper.load(FAR / ('a.' + 'txt'))"
    jobs = [job_of(tmp_path / "out", name, given) for name in ("one", "two")]
    for job in jobs:
        run_job(Plugins(), job.name, job.work, job.made, (), job.keyed | {helper})
    assert all(job.fresh for job in jobs)
    (far / "a.txt").write_text("2")
    assert not any(job.fresh for job in jobs)


def test_other_plugins_of_the_process_do_not_count(tmp_path, far):
    first = done(job_of(tmp_path / "out", "one", "def read(): open(FAR / ('a.' + 'txt'))"))
    second = done(job_of(tmp_path / "out", "two", "def read(): pass"))
    (far / "a.txt").write_text("2")
    assert second.fresh and not first.fresh


def test_a_file_that_is_edited_while_the_job_runs_makes_it_stale(tmp_path, far):
    reads = "def read():\n    (FAR / ('a.' + 'txt')).read_text()\n    subprocess.run(['sh', HERE / 'edit'])"
    (tmp_path / "here" / "edit").write_text(f"sleep 0.02; echo 2 > {far}/a.txt")
    job = done(job_of(tmp_path / "out", "mine", reads))
    assert CHANGED in Record.read(job.place.record).inputs.files.values()
    assert not job.fresh
    (tmp_path / "here" / "edit").write_text("")
    assert done(job).fresh


def test_inputs_beside_a_plugin_move_with_it(tmp_path, far, monkeypatch):
    """As a clone of a project, or the same on another machine; the old place may be there with other content."""
    (tmp_path / "here" / "net").mkdir()
    (tmp_path / "here" / "net" / "a.bin").write_text("1")
    job = done(job_of(tmp_path / "out", "mine", "def read(): [p.read_text() for p in (HERE / ('n' + 'et')).iterdir()]"))
    moved = tmp_path / "moved"
    subprocess.run(["cp", "-r", tmp_path / "here", moved], check=True)
    (tmp_path / "here" / "net" / "a.bin").write_text("2")
    assert not job.fresh
    monkeypatch.setattr(sys, "path", [str(moved), *(place for place in sys.path if place != str(tmp_path / "here"))])
    assert job.fresh
    (moved / "net" / "a.bin").write_text("3")
    assert not job.fresh


def test_what_is_made_of_a_job_is_made_again_with_it(tmp_path, far):
    """Its key is that of before, as is that of the job: only the file that the job read is another."""
    first = job_of(tmp_path / "out", "mine", "def read(): open(FAR / ('a.' + 'txt'))")
    second = Job(
        verb="score", name="second", work=partial(note, tmp_path / "out" / "second.json"), root=tmp_path / "out",
        marker=tmp_path / "out" / "second.json", content_hash="y", needs=(first,),
    )  # fmt: skip
    with ThreadPoolExecutor(1) as pool:
        assert [job.name for job in run_graph([first, second], pool).done] == ["mine", "second"]
        assert run_graph([first, second], pool).done == []
        (far / "a.txt").write_text("2")
        second.marker.with_suffix(".count").unlink()
        assert [job.name for job in run_graph([first, second], pool).done] == ["mine", "second"]
    assert second.marker.with_suffix(".count").exists()


def note(marker, content_hash, on_step):
    marker.with_suffix(".count").write_text("")
    marker.write_text(json.dumps({"content_hash": content_hash}))


def test_a_record_without_seen_inputs_is_read(tmp_path, far):
    job = done(job_of(tmp_path / "out", "mine", "def read(): open(FAR / ('a.' + 'txt'))"))
    about = json.loads(job.place.record.read_text())
    del about["inputs"]
    job.place.record.write_text(json.dumps(about))
    assert Record.read(job.place.record).inputs == SeenInputs()
    assert job.fresh


TRACKER = """
from dataclasses import dataclass
from pathlib import Path
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

@dataclass(frozen=True)
class Off:
    def start(self, structure, camera, cam_from_world, rng):
        off_m = float((Path(__file__).parents[1] / ("of" + "f.txt")).read_text())
        return Run(Pose.exp([off_m, 0, 0, 0, 0, 0]) @ cam_from_world)

class Run:
    def __init__(self, pose):
        self.pose = pose

    def track(self, image, stamp_ns):
        return TrackResult(status="ok", cam_from_world=self.pose)
"""


def test_a_tracker_with_a_hidden_file_is_run_and_scored_anew(tmp_path, monkeypatch):
    monkeypatch.setattr("uavbench.bench.runner.commands.local_pool", in_this_process)
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "tracker_with_hidden_file.py").write_text(TRACKER)
    (tmp_path / "off.txt").write_text("0.01")
    monkeypatch.syspath_prepend(tmp_path / "code")
    (tmp_path / "suite").mkdir()
    trackers = 'off = { kind = "tracker_with_hidden_file:Off" }\nhold = { kind = "hold" }\n'
    path, out = recorded_suite(tmp_path / "suite", trackers), tmp_path / "out"
    for frame in sorted((tmp_path / "suite" / "frames").iterdir())[2:]:
        frame.unlink()

    def scored():
        assert bring_up_to("track", str(path), out, ExecutionOptions()) == 0
        estimates = sorted((out / "results").rglob("off@15hz/estimate_*.tum"))
        return [estimate.read_text() for estimate in estimates]

    before = scored()
    assert all(job.fresh for job in plan(load_suite(path), out, "track"))
    (tmp_path / "off.txt").write_text("0.02")
    stale = {job.name for job in plan(load_suite(path), out, "track") if not job.fresh}
    assert stale == {"track one-s0 off@15hz", "track two-s0 off@15hz"}
    after = scored()
    assert len(before) == len(after) == 2 and before != after
    assert all(job.fresh for job in plan(load_suite(path), out, "track"))
