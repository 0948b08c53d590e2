"""`uavbench bisect`: the commit that made a metric worse, in git repositories made for the test."""

import json
import os
import shutil
import subprocess
from contextlib import nullcontext
from pathlib import Path

import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.gate.paired_scores import Measured, Side
from uavbench.bench.history.bisect import Cannot, Measurement, between, bisect
from uavbench.bench.history.measuring import BISECTION, Measuring
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import write_text

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="absent: git")
ROOT = Path(__file__).parents[2]
SUITE = """
title = "offset"
rates_hz = [15.0]
seeds = [0, 1]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 0.3 }
camera = { width = 64, height = 48, horizontal_fov_deg = 65.0 }
[trackers]
stream = { kind = "external", command = ["python3", "stream.py"] }
still = { kind = "hold" }
"""
STREAM = """
import sys, tomllib
from offset import OFF
print("ready", flush=True)
while line := sys.stdin.buffer.readline():
    words = line.decode().strip().split(",")
    if words[0] == "frame":
        sys.stdin.buffer.read(int(words[2]) * int(words[3]) * int(words[4]))
        print(f"{words[1]},ok,{OFF},0.0,1.0,1.0,0.0,0.0,0.0", flush=True)
"""


def git(folder, *arguments):
    identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(folder, name, text):
    (folder / name).write_text(text)
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", f"{name} {text[:12]!r}", "--allow-empty")
    return git(folder, "rev-parse", "HEAD")


@pytest.fixture
def repository(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    git(tmp_path, "init", "-q", "-b", "main")
    return tmp_path


def measured(values):
    """Measures commits by a table; None cannot run. Tells which were asked for."""
    asked = []

    def measure(name):
        asked.append(name)
        value = values[name]
        return Cannot("it does not build") if value is None else Measurement(value, f"{value:g}")

    return measure, asked


def line(folder, worse, size, *, broken=()):
    """Commits in a line, of which those from `worse` on are worse by 5 %."""
    names = [commit(folder, "number", str(k)) for k in range(size)]
    values = {name: None if k in broken else 0.05 * (k >= worse) + 0.001 * (k % 3) for k, name in enumerate(names)}
    return names, values


@pytest.mark.parametrize("worse", [1, 7, 14, 19])
def test_the_first_worse_commit_of_a_line_is_found_by_halving(repository, worse):
    names, values = line(repository, worse, 20)
    measure, asked = measured(values)
    told = []
    found = bisect(names[0], names[-1], 0.01, measure, told.append)
    assert found.suspects == [names[worse]]
    assert len(asked) == len(set(asked)) <= 7 and len(told) == len(asked)


def test_commits_that_cannot_run_are_skipped_and_said(repository):
    names, values = line(repository, 12, 20, broken=(8, 9, 10))
    found = bisect(names[0], names[-1], 0.01, measured(values)[0], lambda _: None)
    assert found.suspects == [names[12]]
    names, values = line(repository, 12, 20, broken=(10, 11))
    told = []
    found = bisect(names[0], names[-1], 0.01, measured(values)[0], told.append)
    assert found.suspects[0] == names[12] and set(found.suspects[1:]) == {names[10], names[11]}
    assert sum("skipped: it does not build" in word for word in told) == 2


def test_what_a_merge_brought_is_found_on_its_branch(repository):
    names, values = line(repository, 99, 3)
    git(repository, "checkout", "-qb", "side")
    branch = [commit(repository, "side", str(k)) for k in range(4)]
    git(repository, "checkout", "-q", "main")
    own = [commit(repository, "main", str(k)) for k in range(4)]
    git(repository, "merge", "-q", "side", "-m", "merge")
    last = git(repository, "rev-parse", "HEAD")
    values |= dict.fromkeys(own, 0.0) | {name: 0.1 * (k >= 2) for k, name in enumerate(branch)} | {last: 0.1}
    found = bisect(names[0], last, 0.01, measured(values)[0], lambda _: None)
    assert found.suspects == [branch[2]]


def test_a_bisection_without_a_result_leaves_none_of_an_earlier_one(repository, monkeypatch):
    """One that was asked for by mistake, as of an unknown commit, measures nothing and leaves what is there."""
    commit(repository, "notes", "a")
    commit(repository, "notes", "b")
    earlier = repository / "out/bisect/bisect.json"
    write_text(earlier, json.dumps({"metric": "ATE"}, indent=1) + "\n", kind=BISECTION)
    for wrong in (["gone", "--metric", "ATE"], ["HEAD~1", "--metric", "speed"]):
        assert CliRunner().invoke(main, ["bisect", *wrong]).exit_code == 2 and earlier.exists()
    monkeypatch.setattr("uavbench.bench.history.measuring.measuring", lambda *_: nullcontext(1))  # rendering fails
    assert CliRunner().invoke(main, ["bisect", "HEAD~1", "--metric", "ATE"]).exit_code == 1 and not earlier.exists()
    earlier.write_text("mine")
    done = CliRunner().invoke(main, ["bisect", "HEAD~1", "--metric", "ATE"])
    assert done.exit_code == 2 and earlier.read_text() == "mine"


def test_mistakes_are_told(repository):
    names, values = line(repository, 99, 3)
    with pytest.raises(UserError, match="not worse"):
        bisect(names[0], names[2], 0.01, measured(values)[0], lambda _: None)
    with pytest.raises(UserError, match="cannot be measured: it does not build"):
        bisect(names[0], names[2], 0.01, measured({**values, names[2]: None})[0], lambda _: None)
    for good, bad, words in (
        ("HEAD", "HEAD~1", "not an ancestor"),
        ("HEAD", "HEAD", "same commit"),
        ("gone", "HEAD", "gone"),
    ):
        with pytest.raises(UserError, match=words):
            between(good, bad)
    for more, words in ((["--metric", "speed"], "unknown metric"), (["--metric", "latency"], "uavbench compare"),
                        (["--suite", "none.toml"], "none.toml")):  # fmt: skip
        result = CliRunner().invoke(main, ["bisect", "HEAD~1", *more])
        assert result.exit_code == 2 and words in result.output


@pytest.mark.parametrize(("margin", "lost", "enough"), [(0.5, 0.45, False), (0.5, 0.55, True), (0.1, 0.098, False)])
def test_the_margin_of_a_coverage_is_a_difference_of_shares(repository, margin, lost, enough):
    first, last = (commit(repository, "n", str(k)) for k in range(2))
    before, after = (measuring("coverage").of(side_of(share)) for share in (1.0, 1.0 - lost))
    measure = {first: before, last: after}.__getitem__
    if enough:
        assert bisect(first, last, margin, measure, lambda _: None).suspects == [last]
    else:
        with pytest.raises(UserError, match="is not worse than"):
            bisect(first, last, margin, measure, lambda _: None)


def measuring(metric):
    return Measuring(None, Path("suite.toml"), Path("out"), "lsd", 15.0, metric, None)


def side_of(*coverages, crash=""):
    """Runs with the same errors, of which the first crashed."""
    runs = {
        ("lsd@15hz", "s0", k): Measured(coverage=share, errors={"ATE": 0.02}, crash="" if k else crash)
        for k, share in enumerate(coverages)
    }
    return Side(runs)


def test_a_commit_whose_tracker_crashes_is_not_taken_for_a_good_one():
    """Its error is that of the few frames before, smaller than any."""
    found = measuring("ATE").of(side_of(0.1, 1.0, crash="frame 9:\nValueError"))
    assert found == Cannot("it crashes on s0, seed 0: frame 9: ValueError")
    assert measuring("coverage").of(side_of(0.1, 1.0, crash="frame 9")) == Measurement(
        -0.55, "coverage 0.5500", share=True
    )
    assert measuring("ATE").of(side_of(0.5, 1.0)).text == "ATE 0.02 m, coverage 75.0 %"


def test_a_commit_without_the_score_of_a_run_is_not_measured():
    missing = Side(side_of(1.0).runs, {("lsd@15hz", "s1", 0): "score.json: no such file"})
    for metric in ("ATE", "coverage"):
        assert measuring(metric).of(missing) == Cannot("no score of s1, seed 0: score.json: no such file")


@pytest.mark.ci
@pytest.mark.slow
def test_trackers_run_from_each_commit_s_own_tree(repository, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "src"), str(ROOT)]))
    (repository / "suite.toml").write_text(SUITE)
    (repository / "stream.py").write_text(STREAM)
    (repository / ".gitignore").write_text("out/\n")
    commit(repository, "offset.py", "OFF = 0.1\n")
    commit(repository, "notes", "nothing\n")
    commit(repository, "offset.py", "OFF = 1 +\n")
    worse = commit(repository, "offset.py", "OFF = 9.0\n")
    commit(repository, "notes", "more\n")
    arguments = ["bisect", "HEAD~4", "--suite", "suite.toml", "--metric", "ATE", "--jobs", "1"]
    several = CliRunner().invoke(main, arguments)
    assert several.exit_code == 2 and "--tracker: stream@15hz, still@15hz" in several.output
    result = CliRunner().invoke(main, [*arguments, "--tracker", "stream"])
    about = json.loads((repository / "out/bisect/bisect.json").read_text())
    assert about["suspects"][0] == worse, result.output
    assert sum("skipped" in each for each in about["tried"].values()) == 1
    assert result.exit_code == 3 and "cannot run" in result.output
    more = commit(repository, "offset.py", "OFF = 30.0\n")
    commit(repository, "notes", "all\n")
    again = CliRunner().invoke(main, ["bisect", "HEAD~3", *arguments[2:], "--tracker", "stream@15hz"])
    assert again.exit_code == 0 and f"first worse commit: {more[:7]}" in again.output, again.output
    assert git(repository, "status", "--porcelain", "-uno") == ""
