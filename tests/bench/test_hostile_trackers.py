"""External trackers that turn on their own job folder: nothing else is read or written, and nothing is left."""

import os
import sys
from pathlib import Path

import pytest

from uavbench.bench.external.kept_folder import MOST_BYTES, MOST_LEVELS, keep
from uavbench.bench.external.program import External, track_external
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.processes.guard import Guard

SECRET = "the last line of somebody else's file"
BEGIN = """
import os, shutil, signal, sys
here = os.getcwd()
def instead(name):
    if os.path.lexists(name): os.unlink(name)
    return name
"""
DEEP = "for _ in range(3000): os.mkdir('d'); os.chdir('d')\nos.chdir(here)\n"


@pytest.fixture
def ended(tmp_path, monkeypatch):
    """Runs a program in the folder form; (its first fault, its kept folder). Temporary folders lie in `temporary`."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))

    def run(text):
        program = tmp_path / "program.py"
        program.write_text(BEGIN + text)
        tracker = External(command=(sys.executable, str(program)), mode="folder")
        kept = tmp_path / "kept"
        results = track_external(tracker, Sequence.load(TRIAL), rate_hz=1.0, seed=0, kept_folder=kept)
        return results.record["errors"][0], kept

    return run


@pytest.mark.parametrize(
    "change",
    [
        "os.unlink('stderr.txt')",
        "os.mkfifo(instead('stderr.txt'))",
        "os.symlink('/dev/zero', instead('stderr.txt'))",
        "os.symlink({secret!r}, instead('stderr.txt'))",
        "os.mkdir(instead('stderr.txt'))",
        "shutil.rmtree(here)",
        "os.rename(here, here + '-moved'); os.symlink(os.path.dirname({secret!r}), here)",
    ],
)
def test_the_last_words_are_the_programs_own(ended, tmp_path, change):
    (tmp_path / "elsewhere").mkdir()
    secret = tmp_path / "elsewhere" / "secret.txt"
    secret.write_text(SECRET)
    change = change.format(secret=str(secret))
    fault, kept = ended(f"print('before', file=sys.stderr, flush=True)\n{change}\nsys.exit(3)")
    assert fault.startswith("[crashed] the run: it ended with exit code 3") and "before" in fault
    assert not [path for path in kept.rglob("*") if path.is_file() and SECRET in path.read_text(errors="replace")]
    assert fault in (kept / "faults.txt").read_text()
    assert [path.name for path in secret.parent.iterdir()] == ["secret.txt"]


def test_a_real_time_signal_is_told_by_its_number(ended):
    assert "killed by signal 40 " in ended("os.kill(os.getpid(), 40)")[0]


@pytest.mark.parametrize("name", ["faults.txt", "uavbench.json", "stdout.txt", "stderr.txt"])
@pytest.mark.parametrize("way", ["link", "dangling", "folder", "text"])
def test_no_name_of_a_program_changes_what_is_written_beside_it(ended, tmp_path, name, way):
    other = tmp_path / "other.txt"
    if way == "link":
        other.write_text(SECRET)
    make = {"text": f"open(instead({name!r}), 'w').write('[1, 2')", "folder": f"os.mkdir(instead({name!r}))"}
    fault, kept = ended(make.get(way, f"os.symlink({str(other)!r}, instead({name!r}))") + "\nsys.exit(3)")
    assert (other.read_text() if other.exists() else "") == (SECRET if way == "link" else "")
    assert (kept / "faults.txt").read_text().startswith(fault)
    assert fault == ended("sys.exit(3)")[0]  # and the kept folder is recognized as ours


def test_a_deep_job_folder_is_kept_in_part_and_removed_whole(ended, tmp_path):
    fault, kept = ended(DEEP + "sys.exit(3)")
    assert "exit code 3" in fault
    assert f"more than {MOST_LEVELS} levels deep" in (kept / "faults.txt").read_text()
    assert (kept / "job.toml").exists()
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_folder_without_permissions_is_removed(tmp_path):
    with Guard("uavbench-test-") as guard:
        (guard.folder / "closed" / "inner").mkdir(parents=True)
        (guard.folder / "closed").chmod(0)
    assert not guard.folder.exists()


def test_a_link_in_place_of_the_folder_is_removed_and_not_what_it_leads_to(tmp_path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").write_text("x")
    with Guard("uavbench-test-") as guard:
        guard.folder.rmdir()
        guard.folder.symlink_to(tmp_path / "precious")
    assert not os.path.lexists(guard.folder)
    assert (tmp_path / "precious" / "file").read_text() == "x"


def test_what_is_too_large_or_too_many_is_left_out_and_told(tmp_path, monkeypatch):
    monkeypatch.setattr("uavbench.bench.external.kept_folder.MOST_FILES", 3)
    job = tmp_path / "job"
    (job / "many").mkdir(parents=True)
    with (job / "large").open("wb") as handle:
        handle.truncate(MOST_BYTES + 1)
    for number in range(9):
        (job / "many" / str(number)).touch()
    os.mkfifo(job / "pipe")
    keep(job, tmp_path / "kept", ["a fault"])
    told = Path(tmp_path / "kept" / "faults.txt").read_text()
    assert "files of more than 16,777,216 bytes" in told and "more than 3 files" in told
    assert len(list((tmp_path / "kept" / "many").iterdir())) == 3
    assert {path.name for path in (tmp_path / "kept").iterdir()} == {"many", "faults.txt", "uavbench.json"}
