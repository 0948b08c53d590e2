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
        if "FORKED" in os.environ:  # a child went on as a worker: it must not multiply
            os._exit(1)
        if os.fork() == 0:
            os.environ["FORKED"] = place
            if self.child == "raises":
                raise ValueError("in the child")
            if self.child == "sleeps":
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
    def __init__(self, method, code):
        self.method, self.code = method, code

    def sense(self, samples):
        self.fork("sense")

    def predict(self, cam_from_world, covariance):
        self.fork("predict")

    def track(self, image, stamp_ns):
        self.fork("track")
        return TrackResult(status="lost")

    def fork(self, place):
        if place == self.method and not (child := os.fork()):
            if self.code:
                sys.exit(self.code)
        elif place == self.method:
            print("child", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)

for method in ("sense", "predict", "track"):
    for code in (0, 3):
        error = track_frame(Run(method, code), None, 0, {}, Prediction(None, None)).error
        print(method, error or "no error", flush=True)
"""
CHILDREN = ("returns", "raises", "sleeps")
DEADLINE_S = 500
"""Longer than such a suite takes on a busy machine, shorter than the children sleep."""


@pytest.mark.slow(seconds=10)
def test_the_command_ends_with_one_result_of_each_and_its_output_closed(tmp_path):
    (tmp_path / "forking.py").write_text(TRACKER)
    kinds = [f'{child} = {{ kind = "forking:Forking", child = "{child}" }}\n' for child in CHILDREN]
    suite = recorded_suite(tmp_path, "".join(kinds))
    given = ["track", str(suite), "--out", str(tmp_path / "out"), "--jobs", "1"]
    command = [sys.executable, "-m", "uavbench.bench.cli.main", *given]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 0, done.stderr
    assert "0 failed" in done.stderr
    told = [line.split()[2] for line in done.stderr.splitlines() if line.startswith("  track ")]
    assert sorted(told) == sorted(f"{child}@15hz" for child in CHILDREN for _ in ("one", "two"))


def test_a_process_forked_in_any_method_ends_there_with_its_exit_code():
    done = subprocess.run([sys.executable, "-c", FRAME], capture_output=True, text=True, check=False)
    lines = [f"child {code}\n{method} no error\n" for method in ("sense", "predict", "track") for code in (0, 3)]
    assert (done.stdout, done.returncode) == ("".join(lines), 0), done.stderr
