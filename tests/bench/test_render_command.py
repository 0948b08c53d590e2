"""`uavbench render` of many short sequences: the same bytes whatever --jobs, and after a kill."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SEQUENCES = 3
KILLED_AFTER = 1
"""Sequences that are whole when the render is killed."""
SUITE = f"""
title = "Many"
seeds = {list(range(SEQUENCES))}
rates_hz = [10.0]
[sequences.s]
rate_hz = 10.0
structure = {{ kind = "box" }}
environment = {{ kind = "indoor", floor = "carpet" }}
flight.path = {{ kind = "hand-pilot", duration_s = 0.2 }}
camera = {{ width = 64, height = 48, horizontal_fov_deg = 65.0 }}
effects = [{{ kind = "motion-blur" }}, {{ kind = "noise" }}]
annotations = ["depth", "mask", "edges"]
[trackers]
hold = {{ kind = "hold" }}
"""


def start(suite: Path, out: Path, jobs: int) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "uavbench.bench.cli.main",
        "render",
        str(suite),
        "--out",
        str(out),
        "--jobs",
        str(jobs),
    ]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )


def sequences(out: Path) -> dict[str, Path]:
    """Manifests of the sequences that are whole, by name."""
    return {path.parent.name: path for path in sorted(out.glob("sequences/[!.]*/manifest.json"))}


@pytest.mark.ci
@pytest.mark.slow
def test_a_killed_render_redoes_one_sequence_a_worker_and_ends_as_any_other(tmp_path: Path) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text(SUITE)
    two = start(suite, tmp_path / "two", 2)
    said, _ = two.communicate()
    assert two.returncode == 0, said
    one = start(suite, tmp_path / "one", 1)
    while len(sequences(tmp_path / "one")) < KILLED_AFTER:
        assert one.poll() is None, one.communicate()[0]
        time.sleep(0.02)
    os.killpg(one.pid, signal.SIGKILL)
    one.communicate()
    before = {name: path.stat().st_mtime_ns for name, path in sequences(tmp_path / "one").items()}
    assert len(before) >= KILLED_AFTER
    again = start(suite, tmp_path / "one", 1)
    said, _ = again.communicate()
    assert again.returncode == 0, said
    after, other = sequences(tmp_path / "one"), sequences(tmp_path / "two")
    redone = [name for name, stamp in before.items() if after[name].stat().st_mtime_ns != stamp]
    assert len(redone) <= 1
    assert len(after) == SEQUENCES
    assert {name: path.read_bytes() for name, path in after.items()} == {
        name: path.read_bytes() for name, path in other.items()
    }
