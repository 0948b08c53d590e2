"""A job is fresh only while all that it wrote is as it was written, whatever happened between and to whatever file."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from uavbench.bench.inputs.content_hash import content_hash
from uavbench.bench.runner.graph import Job, fresh_jobs, run_graph
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.listed import Marker
from uavbench.trajectories.files.writing import new_folder, new_parts, write_text

LIST = Marker("list.json", "list")


@dataclass(frozen=True)
class Folder:
    """Work like that of render and track: a folder with a file for each frame."""

    folder: Path
    frames: int = 3
    wait_s: float = 0.0

    def __call__(self, content_hash, on_step):
        with new_folder(self.folder, LIST) as new:
            for frame in range(self.frames):
                write_text(new / "frames" / f"{frame}.csv", f"{content_hash} {frame}\n")
                time.sleep(self.wait_s)
            write_text(new / "record.json", json.dumps({"content_hash": content_hash}))


@dataclass(frozen=True)
class Note:
    """Work like that of score: one file in the folder of another job."""

    path: Path

    def __call__(self, content_hash, on_step):
        write_text(self.path, json.dumps({"content_hash": content_hash}, indent=1) + "\n", kind=LIST.kind)


@dataclass(frozen=True)
class Page:
    """Work like that of report: files among others, the marker last."""

    folder: Path
    dies: bool = False

    def __call__(self, content_hash, on_step):
        with new_parts(self.folder, Marker("report.json", "report")) as new:
            write_text(new / "scores.json", content_hash)
            write_text(new / "report.json", json.dumps({"content_hash": content_hash}))
        if self.dies:
            os._exit(3)


def suite(root, enters=0, **more):
    """Jobs of a folder, of a note in it, and of a page over both."""
    hashes = [content_hash(name, enters) for name in ("render", "score", "report")]
    one, two = root / "results" / "a", root / "results" / "b"
    folders = [
        Job(verb="track", name=f"track {path.name}", work=Folder(path), marker=path / "record.json", root=root,
            lists=LIST, content_hash=hashes[0])
        for path in (one, two)
    ]  # fmt: skip
    note = Job(verb="score", name="score", work=Note(one / "score.json"), marker=one / "score.json", root=root,
               content_hash=hashes[1], needs=(folders[0],))  # fmt: skip
    page = Job(verb="report", name="report", work=Page(root, **more), marker=root / "report.json", root=root,
               content_hash=hashes[2], needs=(note, folders[1]))  # fmt: skip
    return [*folders, note, page]


def done(root, enters=0):
    with ThreadPoolExecutor(1) as pool:
        outcome = run_graph(suite(root, enters), pool)
    assert not outcome.failed
    return sorted(job.name for job in outcome.done)


def contents(root):
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and "made" not in path.parts
    }


ALL = ["report", "score", "track a", "track b"]
OF_A = ["report", "score", "track a"]


def junk(path):
    """Other bytes, of the same size, with the same time."""
    before = path.stat()
    path.write_bytes(b"?" * before.st_size)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


DAMAGE = {
    "deleted": Path.unlink,
    "junk of the same size": junk,
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "emptied": lambda path: path.write_bytes(b""),
    "grown": lambda path: path.write_bytes(path.read_bytes() + b"\n"),
}


@pytest.mark.parametrize("how", DAMAGE)
@pytest.mark.parametrize(
    ("name", "again"),
    [
        ("results/a/frames/1.csv", OF_A),
        ("results/a/record.json", OF_A),
        ("results/a/list.json", OF_A),
        ("results/a/score.json", ["report", "score"]),
        ("results/b/frames/0.csv", ["report", "track b"]),
        ("scores.json", ["report"]),
        ("report.json", ["report"]),
    ],
)
def test_what_is_damaged_is_made_again_with_what_was_made_of_it_and_nothing_else(tmp_path, how, name, again):
    assert done(tmp_path) == ALL
    assert done(tmp_path) == []
    whole = contents(tmp_path)
    DAMAGE[how](tmp_path / name)
    assert done(tmp_path) == again
    assert contents(tmp_path) == whole
    assert done(tmp_path) == []


def test_a_copy_is_fresh_and_is_read_through_once(tmp_path):
    done(tmp_path / "a")
    shutil.copytree(tmp_path / "a", tmp_path / "b", copy_function=shutil.copyfile)
    records = sorted((tmp_path / "b" / "made").rglob("*.json"))
    before = [path.read_bytes() for path in records]
    assert done(tmp_path / "b") == []
    after = [path.read_bytes() for path in records]
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert done(tmp_path / "b") == []
    assert [path.read_bytes() for path in records] == after


@pytest.mark.parametrize("name", ["results/a/notes.txt", "results/b/frames/.3.csv", "results/a/deep/thesis.tex"])
def test_a_users_file_among_the_results_is_named_before_anything_is_done(tmp_path, name):
    done(tmp_path)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    for enters in (0, 1):
        before = contents(tmp_path)
        with pytest.raises(UserError, match=Path(name).name.strip(".")):
            done(tmp_path, enters)
        assert contents(tmp_path) == before


def test_a_record_that_is_lost_or_damaged_costs_work_and_no_more(tmp_path):
    done(tmp_path)
    whole = contents(tmp_path)
    for damage in (lambda path: path.unlink(), lambda path: path.write_text("{")):
        for record in sorted((tmp_path / "made").rglob("*.json")):
            damage(record)
            if record.exists():
                record.unlink()
        assert done(tmp_path) == ALL
        assert contents(tmp_path) == whole


def test_the_first_suite_again_after_a_second_was_killed_in_its_report(tmp_path):
    done(tmp_path)
    of_first = (tmp_path / "scores.json").read_bytes()
    code = "import sys; from pathlib import Path; from concurrent.futures import ThreadPoolExecutor\n"
    code += "from uavbench.bench.runner.graph import run_graph; from tests.bench.test_freshness import suite\n"
    code += "run_graph(suite(Path(sys.argv[1]), 1, dies=True), ThreadPoolExecutor(1))"
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, check=False).returncode == 3
    assert (tmp_path / "scores.json").read_bytes() != of_first
    assert "report" in done(tmp_path)
    assert (tmp_path / "scores.json").read_bytes() == of_first


KILLED = """
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from uavbench.bench.runner.graph import run_graph
from tests.bench.test_freshness import suite
jobs = [replace(job, work=replace(job.work, wait_s=0.002)) if job.verb == "track" else job
        for job in suite(Path(sys.argv[1]), int(sys.argv[2]))]
print("begun", flush=True)
with ThreadPoolExecutor(1) as pool:
    run_graph(jobs, pool)
"""


def test_killed_at_any_moment_of_making_anew_the_end_is_the_same(tmp_path):
    from uavbench.bench.runner.output_folder import clean_leftovers

    done(tmp_path / "whole", 0)
    whole = contents(tmp_path / "whole")
    root = tmp_path / "out"
    done(root, 0)
    for moment_s in (0.0, 0.004, 0.012, 0.02, 0.03, 0.05):
        command = [sys.executable, "-c", KILLED, str(root), "1"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert process.stdout.readline() == "begun\n"
        time.sleep(moment_s)
        process.send_signal(signal.SIGKILL)
        process.wait()
        clean_leftovers(root, alone=True)
        assert not list(root.rglob(".*"))
        done(root, 0)
        assert contents(root) == whole


def test_the_check_of_a_fresh_suite_reads_no_file_of_it(tmp_path, monkeypatch):
    done(tmp_path)
    read = []
    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda path, *a, **k: (read.append(path), opened(path, *a, **k))[1])
    assert len(fresh_jobs(suite(tmp_path))) == 4
    assert not [path for path in read if path.suffix == ".csv"]


FULL = """
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uavbench.bench.runner.graph import run_graph
from uavbench.bench.runner.commands import tell
from tests.bench.test_freshness import suite
root = Path(sys.argv[1])
(root / "filler").write_bytes(b"0" * 40 * 4096)
outcome = run_graph(suite(root), ThreadPoolExecutor(1))
outcome.tracebacks["a"] = "x" * 100_000  # more than fits
tell(outcome, root, "a.toml")
print(sorted(outcome.failed), outcome.users_mistake, [path.name for path in root.rglob("*") if path.is_file()])
"""


def test_a_full_disk_is_told_as_such_and_is_left_as_it_was(tmp_path):
    inside = f"mount -t tmpfs -o size={48 * 4096} none {tmp_path} && exec {sys.executable} -c '{FULL}' {tmp_path}"
    command = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", inside]
    if shutil.which("unshare") is None or subprocess.run([*command[:4], "true"], check=False).returncode:
        pytest.skip("no mounts of its own for a user on this machine")
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stderr
    assert "Traceback" not in process.stderr
    assert "No space left on device" in process.stderr
    failed, *_ = process.stdout.rpartition(" [")
    assert failed.endswith("False"), "no mistake in the input"
    assert "report" in failed
    assert "failures.txt" not in process.stdout
    assert "uavbench-" not in process.stdout


def test_what_failed_before_is_not_told_after_a_success(tmp_path):
    from uavbench.bench.runner.commands import tell
    from uavbench.bench.runner.graph import Outcome

    tell(Outcome(failed={"a": "oops"}, tracebacks={"a": "Traceback: oops"}), tmp_path, "a.toml")
    assert "oops" in (tmp_path / "failures.txt").read_text()
    tell(Outcome(), tmp_path, "a.toml")
    assert not (tmp_path / "failures.txt").exists()
    (tmp_path / "failures.txt").write_text("a user's own")
    tell(Outcome(), tmp_path, "a.toml")
    tell(Outcome(failed={"a": "oops"}, tracebacks={"a": "Traceback: oops"}), tmp_path, "a.toml")
    assert (tmp_path / "failures.txt").read_text() == "a user's own"


@pytest.mark.parametrize("verb", ["run", "render"])
def test_a_name_that_no_disk_takes_is_a_mistake_that_is_told(tmp_path, verb):
    from click.testing import CliRunner

    from tests.bench.small_suites import small_suite
    from uavbench.bench.cli.main import main

    result = CliRunner().invoke(main, [verb, str(small_suite(tmp_path)), "--out", str(tmp_path / ("n" * 256))])
    assert result.exit_code == 2
    assert "too long" in result.output
    assert "Traceback" not in result.output
