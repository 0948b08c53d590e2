"""Two versions of the repository on the same frames, from a git repository made for the test."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from bench.cli import main
from bench.compare import smallest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
SUITE = """
title = "compare"
seeds = [0, 1, 2, 3, 4]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hand-pilot", duration_s = 1.2 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""
WORSE = "return TrackResult(status='ok', cam_from_world=Pose.exp([0.5, 0.0, 0.0, 0.0, 0.1, 0.0]) @ self.cam_from_world)"


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    folder = tmp_path_factory.mktemp("repository")
    for package in ("bench", "reports", "scenes", "tracker", "trajectories"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)

    def git(*arguments):
        identity = ["-c", "user.name=test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false"]
        subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True)

    git("init", "-q")
    git("add", "-A")
    git("commit", "-qm", "base")
    git("tag", "base")
    hold = folder / "tracker" / "hold.py"
    text = hold.read_text()
    line = 'return TrackResult(status="ok", cam_from_world=self.cam_from_world)'
    assert line in text
    hold.write_text(text.replace(line, WORSE))
    git("commit", "-qam", "worse")
    (folder / "suite.toml").write_text(SUITE)
    return folder


def compare(repository, monkeypatch, *refs):
    monkeypatch.chdir(repository)
    arguments = ["compare", *refs, "--suite", "suite.toml", "--repeats", "2", "--jobs", "1", "--latency-margin", "400%"]
    result = CliRunner().invoke(main, [*arguments, "--resolution", "500%"])
    return result, json.loads((repository / "out/compare/gate/gate.json").read_text()) if result.exit_code in (
        0, 1, 3
    ) else None  # fmt: skip


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


def test_a_ref_that_is_none_is_a_users_mistake(repository, monkeypatch):
    result, _ = compare(repository, monkeypatch, "no-such-ref", ".")
    assert result.exit_code == 2
    assert "git rev-parse" in result.output


def test_of_each_frame_the_smallest_time_counts():
    times = {
        ("t", "t@15hz", "box-s3", 3, "base"): [[1.0, 9.0, 3.0], [2.0, 2.0, 3.0]],
        ("t", "t@15hz", "box-s3", 3, "head"): [[4.0, 4.0, 4.0], [5.0, 3.0, 9.0]],
    }
    assert smallest(times, ["t"]) == {"t@15hz": [{"sequence": "box", "seed": 3, "base_ms": 2.0, "head_ms": 4.0}]}
    assert smallest(times, []) == {}
    quick = {key: [[0.001]] for key in times}
    assert smallest(quick, ["t"])["t@15hz"][0]["head_ms"] == 0.05
