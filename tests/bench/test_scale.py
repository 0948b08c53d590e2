"""Plans: shards, dry runs, time estimates, and a plan of a thousand jobs."""

import json
import secrets
import subprocess
import sys
from dataclasses import astuple, replace

import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.config.shard import Shard
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.estimate import dry_run, remember
from uavbench.bench.runner.graph import Outcome
from uavbench.bench.runner.jobs import plan
from uavbench.bench.runner.output_folder import clean_leftovers, suite_folder
from uavbench.bench.runner.written_files import Stamp
from uavbench.tracker.initialization import CoarseGuess, PickedPoints
from uavbench.trajectories.errors import UserError

SUITE = """
title = "Many"
seeds = {seeds}
rates_hz = [15.0, 5.0]

[sequences.a]
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot", duration_s = 10.0 }}

[sequences.b]
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot", duration_s = 20.0 }}

[trackers]
hold = {{ kind = "hold" }}
lsd = {{ kind = "lsd" }}
"""


def suite(tmp_path, seeds):
    path = tmp_path / "many.toml"
    path.write_text(SUITE.format(seeds=list(range(seeds))))
    return load_suite(path)


def mark(job):
    job.marker.parent.mkdir(parents=True, exist_ok=True)
    job.marker.write_text(json.dumps({"content_hash": job.content_hash}))
    job.place.record.parent.mkdir(parents=True, exist_ok=True)
    files = {job.marker.relative_to(job.root).as_posix(): astuple(Stamp.of(job.marker))}
    job.place.record.write_text(json.dumps({"content_hash": job.content_hash, "files": files}))


def test_shards_are_a_partition(tmp_path):
    whole = suite(tmp_path, 5)
    parts = [Shard(i, 3).of(whole).sequences for i in (1, 2, 3)]
    assert sorted(spec.name for part in parts for spec in part) == sorted(spec.name for spec in whole.sequences)
    hashes = {job.name: job.content_hash for job in plan(whole, tmp_path, last="score")}
    for i in (1, 2, 3):
        for job in plan(Shard(i, 3).of(whole), tmp_path, last="score"):
            assert hashes.pop(job.name) == job.content_hash
    assert not hashes


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "a/b", "1/", "-1/2", "1/2/3"])
def test_a_bad_shard_is_a_users_mistake(text):
    with pytest.raises(UserError, match="i/N"):
        Shard.parse(text)


def test_two_shards_share_a_folder_the_same_one_twice_does_not(tmp_path):
    whole, folder = suite(tmp_path, 2), tmp_path / "out"
    with suite_folder(folder, whole, Shard(1, 2)), suite_folder(folder, whole, Shard(2, 2)):
        with pytest.raises(UserError, match="another uavbench process"), suite_folder(folder, whole, Shard(1, 2)):
            pass
        with pytest.raises(UserError, match="another uavbench process"), suite_folder(folder, whole):
            pass
    with suite_folder(folder, whole):
        pass


def test_leftovers_go_on_every_level_and_what_a_user_has_there_stays(tmp_path):
    for name in (
        "",
        "sequences",
        "results/b-s0",
        "results/b-s0/hold@15hz",
        "restarts/b-s0/hold@15hz",
        "failed/b-s0",
        "made/a",
    ):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / name / ".my-notes").touch()
        token = secrets.token_hex(16)
        (tmp_path / name / f".a-uavbench-{token}.owner").symlink_to(f"uavbench elsewhere 1 1 {token}")
        (tmp_path / name / f".a-uavbench-{token}" / "frames").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    clean_leftovers(tmp_path, alone=False)
    assert sorted(tmp_path.rglob("*")) == before, "those of another shard's machine"
    clean_leftovers(tmp_path, alone=True)
    assert {p.name for p in tmp_path.rglob(".*")} == {".my-notes"}


START = """
import sys
from pathlib import Path
from uavbench.bench.config.suite import load_suite
from uavbench.bench.runner.output_folder import clean_leftovers, suite_folder
from uavbench.bench.config.shard import Shard
suite, number, folder = load_suite(Path(sys.argv[1])), int(sys.argv[2]), Path(sys.argv[3])
print("ready", flush=True)
sys.stdin.read()
for again in range(20):
    with suite_folder(folder / str(again), suite, Shard(number, 4)):
        pass
"""


def test_shards_that_start_together_in_one_folder_do_not_trip_over_each_other(tmp_path):
    suite(tmp_path, 1)
    (tmp_path / "out").mkdir()
    command = [sys.executable, "-c", START, str(tmp_path / "many.toml")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    shards = [subprocess.Popen([*command, str(n), str(tmp_path / "out")], **pipes) for n in range(1, 5)]
    assert [shard.stdout.readline() for shard in shards] == ["ready\n"] * 4
    for shard in shards:
        shard.stdin.close()
    assert [(shard.wait(), shard.stderr.read()) for shard in shards] == [(0, "")] * 4
    left = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file() or path.is_symlink()}
    assert left == {".lock", "suite.json", *(f".lock_{n}_of_4" for n in range(1, 5))}


def test_a_dry_run_counts_and_learns_from_what_was_measured(tmp_path):
    jobs = plan(suite(tmp_path, 2), tmp_path / "out")
    first = dry_run(jobs, tmp_path / "out", workers=2)
    assert "reference figures" in first
    assert "measured" not in first
    render = next(job for job in jobs if job.verb == "render")
    mark(render)
    remember(Outcome(seconds={render.name: 100.0 * render.weight}), tmp_path / "out")
    rest = sum(job.weight for job in jobs if job.verb == "render") - render.weight
    line = next(line for line in dry_run(jobs, tmp_path / "out", workers=2).splitlines() if line.startswith("render"))
    assert line.split()[1:5] == ["4", "1", "3", f"{100.0 * rest:.1f}"]
    assert "1 measured here" in line


def test_the_command_prints_the_plan_and_does_nothing(tmp_path):
    suite(tmp_path, 1)
    out = tmp_path / "out"
    result = CliRunner().invoke(main, ["run", str(tmp_path / "many.toml"), "--out", str(out), "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "of one core" in result.output
    assert not out.exists()


def test_a_thousand_jobs_are_planned_again_and_only_those_without_their_result_are_not_fresh(tmp_path):
    whole = suite(tmp_path, 56)  # 112 sequences, 448 runs, 448 scores, the report
    jobs = plan(whole, tmp_path / "out")
    assert len(jobs) == 112 + 2 * 448 + 1
    assert not any(job.fresh for job in jobs)
    for job in jobs:
        mark(job)
    absent, stale, damaged = jobs[17], jobs[500], jobs[-1]
    absent.marker.unlink()
    stale.marker.write_text(json.dumps({"content_hash": absent.content_hash}))
    damaged.marker.write_text(damaged.marker.read_text()[:-2])
    again = plan(whole, tmp_path / "out")
    assert [job.content_hash for job in again] == [job.content_hash for job in jobs]
    assert {job.name for job in again if not job.fresh} == {absent.name, stale.name, damaged.name}


def test_a_run_from_another_first_pose_is_another_run(tmp_path):
    """Renders stay; what is tracked, and all that follows from it, is made again."""
    whole = suite(tmp_path, 1)
    hashes = [
        {job.name: job.content_hash for job in plan(replace(whole, start=start), tmp_path)}
        for start in (whole.start, PickedPoints(), PickedPoints(click_sigma_px=2.0), CoarseGuess())
    ]
    for name in hashes[0]:
        different = {of_start[name] for of_start in hashes}
        assert len(different) == (1 if name.startswith("render") else len(hashes)), name
