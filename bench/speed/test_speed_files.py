"""Time to read and write long files: 1,000,000 poses evaluated, 100 runs evaluated, 1,000 frames exported as a bag.

`pytest bench/speed/test_speed_files.py --benchmark-only`; 160 MB a trajectory, 1.1 GB for the bag.
"""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.ground_truth_files import GROUND_TRUTH_COLUMNS
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import export
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum

POSES = 1_000_000
START_NS, STEP_NS = 1_403_636_579_763_555_584, 5_000_000
RUN_POSES = 10_000
MEASURED = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr)
"""
"""Runs a command and prints its peak memory in KiB: started by a large process, it would inherit the peak of that."""
FRAMES, FRAME_STEP_NS = 1000, 33_333_333
IMU_HZ = 200


def test_a_million_poses_evaluated(benchmark: Any, tmp_path: Path) -> None:
    """`uavbench evaluate` on two TUM files, in its own process, with its peak memory."""
    rng = np.random.default_rng(0)
    stamps = START_NS + STEP_NS * np.arange(POSES)
    p = np.cumsum(rng.normal(0, 0.01, (POSES, 3)), axis=0)
    q = rng.normal([1.0, 0, 0, 0], 0.1, (POSES, 4))
    for name, sigma in (("reference", 0.0), ("estimate", 0.01)):
        noisy = q + rng.normal(0, 1, q.shape) * sigma
        noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
        write_tum(Trajectory(stamps, p + rng.normal(0, 1, p.shape) * sigma, noisy), tmp_path / f"{name}.tum")
    command = [
        *(sys.executable, "-c", MEASURED),
        *(sys.executable, "-m", "uavbench.bench.cli.main", "evaluate"),
        *(str(tmp_path / "reference.tum"), str(tmp_path / "estimate.tum")),
    ]
    peaks_kib = []

    def evaluate() -> None:
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert str(POSES) in done.stdout
        peaks_kib.append(int(done.stderr.split()[-1]))

    benchmark.pedantic(evaluate, rounds=3)
    benchmark.extra_info["largest_memory_mb"] = max(peaks_kib) / 1024


def test_a_hundred_runs_evaluated(benchmark: Any, tmp_path: Path) -> None:
    """`uavbench evaluate` of 20 runs x 5 trackers x 10,000 poses: bootstrap, tests, figures and page."""
    stamps, t = START_NS + STEP_NS * np.arange(RUN_POSES), np.arange(RUN_POSES) / 200
    p = np.column_stack([20 * np.cos(t / 5), 14 * np.sin(t / 4), 3 + np.sin(t)])
    still = np.tile([1.0, 0, 0, 0], (RUN_POSES, 1))
    write_tum(Trajectory(stamps, p, still), tmp_path / "truth.tum")
    command = [sys.executable, "-m", "uavbench.bench.cli.main", "evaluate", "truth.tum", "--align", "se3", "--out"]
    for tracker in range(5):
        for run in range(20):
            noise = np.random.default_rng([tracker, run]).normal(0, 0.02 + 0.005 * tracker, p.shape)
            write_tum(Trajectory(stamps, p + noise, still), tmp_path / f"tracker{tracker}" / f"run{run}.tum")
    groups = [f"--group=t{tracker}=tracker{tracker}/run*.tum" for tracker in range(5)]

    def evaluate() -> None:
        subprocess.run([*command, "out", *groups], cwd=tmp_path, capture_output=True, text=True, check=True)

    benchmark.pedantic(evaluate, rounds=3)
    assert len(json.loads((tmp_path / "out" / "evaluation.json").read_text())["runs"]) == 100


def sequence_of_gradients(folder: Path) -> Sequence:
    """The trial's sequence with 1,000 frames of noisy gradients, whose PNG files have 0.2 MB like rendered ones."""
    shutil.copytree(TRIAL, folder)
    rng = np.random.default_rng(0)
    (folder / "camera.toml").unlink()
    Camera.from_field_of_view(640, 480, 60).save(folder / "camera.toml")
    across = np.linspace(0, 200, 640)[None, :, None] + np.linspace(0, 40, 480)[:, None, None]
    names = []
    for k in range(FRAMES):
        image = (across + rng.integers(0, 3, (480, 640, 1)) + [0, k % 10, 5]).astype(np.uint8)
        names.append(f"frames/{k:06d}.png")
        cv2.imwrite(str(folder / names[-1]), image)
    stamps = FRAME_STEP_NS * np.arange(FRAMES)
    rows = [f"{k},{stamp},{name}" for k, (stamp, name) in enumerate(zip(stamps, names, strict=True))]
    (folder / "frames.csv").write_text("\n".join(["frame,stamp_ns,file", *rows]) + "\n")
    state = "0,0,1,1,0,0,0,0.1,0,0,0,0,0,0,0,0"
    truth = [",".join(GROUND_TRUTH_COLUMNS), *(f"{k},{stamp},{state}" for k, stamp in enumerate(stamps))]
    (folder / "groundtruth.csv").write_text("\n".join(truth) + "\n")
    readings = [f"{stamp},0,0,0,0,0,9.81" for stamp in range(0, int(stamps[-1]), 10**9 // IMU_HZ)]
    head = "stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    (folder / "imu.csv").write_text("\n".join([head, *readings]) + "\n")
    info = json.loads((folder / "sequence.json").read_text())
    (folder / "sequence.json").write_text(json.dumps(info | {"sensors": {"imu.csv": {"kind": "imu"}}}))
    return Sequence.load(folder)


def test_a_bag_of_a_thousand_frames(benchmark: Any, tmp_path: Path) -> None:
    """`export` to MCAP, both raw and compressed, by wall-clock and by processor time."""
    sequence = sequence_of_gradients(tmp_path / "sequence")
    cpu_s: list[float] = []
    rounds = iter(range(100))

    def write() -> None:
        begin = time.process_time()
        out = tmp_path / f"bag{next(rounds)}"
        export(sequence, "mcap", out)
        cpu_s.append(time.process_time() - begin)
        shutil.rmtree(out)

    benchmark.pedantic(write, rounds=2)
    benchmark.extra_info["cpu_s"] = min(cpu_s)
