"""A tracker in Python that forks: neither does its child go on as a worker, nor does the command wait for it."""

import subprocess
import sys

import pytest

from tests.bench.small_suites import recorded_suite

TRACKER = """
import os, time
from dataclasses import dataclass
from uavbench.tracker.protocol import TrackResult

@dataclass(frozen=True)
class Forking:
    child: str

    def start(self, structure, camera, cam_from_world, rng):
        self.fork("start")
        return Run(self, cam_from_world)

    def fork(self, place):
        if os.fork() == 0 and self.child != "returns":
            if self.child == "raises":
                raise ValueError("in the child")
            time.sleep(600)

class Run:
    def __init__(self, tracker, pose):
        self.tracker, self.pose = tracker, pose

    def track(self, image, stamp_ns):
        self.tracker.fork("track")
        return TrackResult(status="ok", cam_from_world=self.pose)
"""
FRAME = """
import os, sys
from uavbench.tracker.protocol import Prediction, TrackResult
from uavbench.tracker.run import track_frame

class Run:
    def sense(self, samples):
        self.fork("sense")

    def predict(self, cam_from_world, covariance):
        self.fork("predict")

    def track(self, image, stamp_ns):
        self.fork("track")
        return TrackResult(status="lost")

    def fork(self, place):
        if place == sys.argv[1] and not (child := os.fork()):
            if sys.argv[2] != "0":
                sys.exit(int(sys.argv[2]))
        elif place == sys.argv[1]:
            print("child", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)

print(track_frame(Run(), None, 0, {}, Prediction(None, None)).error or "no error", flush=True)
"""
DEADLINE_S = 500
"""Longer than such a suite takes on a busy machine, shorter than the children sleep."""


@pytest.mark.slow(seconds=30)
@pytest.mark.parametrize("child", ["returns", "raises", "sleeps"])
def test_the_command_ends_with_one_result_and_its_output_closed(tmp_path, child):
    (tmp_path / "forking.py").write_text(TRACKER)
    suite = recorded_suite(tmp_path, f'forking = {{ kind = "forking:Forking", child = "{child}" }}\n')
    given = ["track", str(suite), "--out", str(tmp_path / "out"), "--jobs", "1"]
    command = [sys.executable, "-m", "uavbench.bench.cli.main", *given]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 0, done.stderr
    assert "0 failed" in done.stderr
    assert done.stderr.count("  track ") == 2  # of two sequences


@pytest.mark.parametrize("code", [0, 3])
@pytest.mark.parametrize("method", ["sense", "predict", "track"])
def test_a_process_forked_in_any_method_ends_there_with_its_exit_code(method, code):
    command = [sys.executable, "-c", FRAME, method, str(code)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == (f"child {code}\nno error\n", 0), done.stderr
