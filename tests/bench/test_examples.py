"""The example trackers in Python and C++ are built and run as their own files say."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from uavbench.bench.config.suite import load_tracker
from uavbench.bench.external.program import track_external
from uavbench.bench.trial.check import TRIAL, check
from uavbench.scenes.dataset.sequence import Sequence

EXAMPLES = Path(__file__).parents[2] / "examples"


def good(tracker, tmp_path):
    lines = list(check(tracker, tmp_path / "kept"))
    assert lines[-1] == "good: the tracker follows the protocol", "\n".join(lines)


def test_the_python_example_tracks_better_than_holding(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    tracker = load_tracker(EXAMPLES / "python_tracker" / "tracker.toml")
    good(tracker, tmp_path)
    sequence = Sequence.load(TRIAL)
    results = track_external(tracker, sequence, rate_hz=15.0, seed=0, kept_folder=tmp_path / "kept")
    last = results.rows[-1].cam_from_world.inverse().translation
    ground_truth = [sequence.true_cam_from_world(f).inverse().translation for f in (0, len(sequence) - 1)]
    assert np.linalg.norm(last - ground_truth[1]) < 0.8 * np.linalg.norm(ground_truth[0] - ground_truth[1])


@pytest.mark.skipif(shutil.which("c++") is None, reason="absent: a C++ compiler (Debian's g++)")
def test_the_cpp_example_is_built_and_keeps_the_protocol(tmp_path):
    folder = tmp_path / "cpp"
    shutil.copytree(EXAMPLES / "cpp_tracker", folder)
    build = ["c++", "-O2", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-o", "tracker", "tracker.cpp"]
    subprocess.run(build, cwd=folder, check=True, capture_output=True)
    assert " ".join(word for word in build if not word.startswith("-W")) in (folder / "tracker.toml").read_text()
    good(load_tracker(folder / "tracker.toml"), tmp_path)
