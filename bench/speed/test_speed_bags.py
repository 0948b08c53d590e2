"""How fast a sequence of 1,000 frames is written as a bag.

`pytest bench/speed/test_speed_bags.py --benchmark-only`; 640 x 480 px, raw and as PNG, 1.1 GB.
"""

import json
import shutil
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import TRUTH_COLUMNS, Sequence
from uavbench.scenes.exports.registry import export

FRAMES, STEP_NS = 1000, 33_333_333
IMU_HZ = 200


def synthetic(folder: Path) -> Sequence:
    """The trial's sequence with 1,000 frames of noisy gradients: their PNG files have 0.2 MB, as rendered ones do."""
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
    stamps = STEP_NS * np.arange(FRAMES)
    rows = [f"{k},{stamp},{name}" for k, (stamp, name) in enumerate(zip(stamps, names, strict=True))]
    (folder / "frames.csv").write_text("\n".join(["frame,stamp_ns,file", *rows]) + "\n")
    state = "0,0,1,1,0,0,0,0.1,0,0,0,0,0,0,0,0"
    truth = [",".join(TRUTH_COLUMNS), *(f"{k},{stamp},{state}" for k, stamp in enumerate(stamps))]
    (folder / "truth.csv").write_text("\n".join(truth) + "\n")
    readings = [f"{stamp},0,0,0,0,0,9.81" for stamp in range(0, int(stamps[-1]), 10**9 // IMU_HZ)]
    head = "stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2"
    (folder / "imu.csv").write_text("\n".join([head, *readings]) + "\n")
    info = json.loads((folder / "sequence.json").read_text())
    (folder / "sequence.json").write_text(json.dumps(info | {"sensors": {"imu.csv": {"kind": "imu"}}}))
    return Sequence.load(folder)


def test_a_bag_of_a_thousand_frames(benchmark: Any, tmp_path: Path) -> None:
    """`export` to MCAP, both raw and compressed; the processor's time is told beside that of the clock."""
    sequence = synthetic(tmp_path / "sequence")
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
