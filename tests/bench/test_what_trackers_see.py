"""Trackers of all three protocols see what may be known, and no true value: no pose, bias, wind, depth, nor seed."""

import csv
import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from uavbench.bench.config.suite import load_suite
from uavbench.bench.external.program import External, track_external
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.table_files import read_table
from uavbench.scenes.generate import generate
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.sensors.registry import SENSORS

SUITE = """
title = "seen"
rates_hz = [15.0]
seeds = [7701]
[sequences.box]
structure = { kind = "box" }
mount = { pitch_deg = -20.0, offset_m = [0.03, 0.01, -0.02] }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 0.4 }
flight.wind = { kind = "dryden" }
sensors = [
    { kind = "imu", gyro_bias_rad_s = 0.1, accel_bias_m_s2 = 0.3, offset_m = [0.0, 0.02, 0.01] },
    { kind = "imu-bmi088", gyro_bias_rad_s = 0.1, rate_hz = 400.0 },
    { kind = "flow" }, { kind = "baro" }, { kind = "gnss" },
    { kind = "range-finder", pitch_deg = -60.0 }, { kind = "lidar-2d", rate_hz = 20.0, step_deg = 2.0 },
]
annotations = ["depth", "mask"]
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""
COMMON = {"job.toml", "camera.toml", "model.obj", "model.cao", "edges.csv", "init.toml", "sensors.toml"}
READINGS = {"imu.csv", "imu-bmi088.csv", "flow.csv", "baro.csv", "gnss.csv", "range-finder.csv"}
LIDAR = "lidar-2d"
OWN = {"stderr.txt", "stdout.txt", "loot.bin", "tmp"}
LOOT = """
import os, sys
loot = open("loot.bin", "wb")
for folder, _, names in os.walk("."):
    for name in names:
        path = os.path.join(folder, name)
        if name not in ("loot.bin", "stderr.txt", "stdout.txt") and not name.endswith(".png"):
            loot.write(open(path, "rb").read() + b"\\n")
"""
STREAM = """
print("ready", flush=True)
while line := sys.stdin.buffer.readline():
    loot.write(line)
    if line.startswith(b"frame,"):
        _, stamp, w, h, c = line.split(b",")
        sys.stdin.buffer.read(int(w) * int(h) * int(c))
        print(stamp.decode() + ",lost", flush=True)
loot.close()
sys.exit(9)
"""


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seen")
    (folder / "suite.toml").write_text(SUITE)
    generate(load_suite(folder / "suite.toml").sequences[0], folder / "sequence", content_hash="seen")
    return Sequence.load(folder / "sequence")


@pytest.fixture(scope="module")
def ground_truths(sequence):
    """Every true number that nobody may see: flight, poses from the second frame on, and biases."""
    secret = set()
    for name in ("flight.csv", "groundtruth.csv", "imu.csv", "imu-bmi088.csv"):
        with (sequence.folder / name).open() as handle:
            rows = list(csv.DictReader(handle))
        for row in rows[1:] if name in ("groundtruth.csv", "flight.csv") else rows:
            secret |= {
                value for key, value in row.items() if name in ("groundtruth.csv", "flight.csv") or "bias" in key
            }
    with (sequence.folder / "range-finder.csv").open() as handle:
        secret |= {row["true_range_m"] for row in csv.DictReader(handle)}
    lidar = np.load(sequence.folder / f"{LIDAR}_truth.npy")
    secret |= {repr(value) for value in lidar["true_range_00_m"].tolist()}
    return {value for value in secret if "." in value and len(value) > 8}


@pytest.mark.parametrize("mode", ["stream", "folder"])
def test_a_program_finds_in_its_folder_and_stream_what_is_listed_and_nothing_true(
    sequence, ground_truths, tmp_path, mode
):
    program = tmp_path / "program.py"
    program.write_text(LOOT + (STREAM if mode == "stream" else "loot.close(); sys.exit(9)"))
    tracker = External(command=(sys.executable, str(program)), mode=mode)
    track_external(tracker, sequence, rate_hz=15.0, seed=7701, kept_folder=tmp_path / "kept")
    folder = tmp_path / "kept"
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    frames = {f"frames/{k:06d}.png" for k in range(len(sequence))} if mode == "folder" else set()
    more = READINGS | {"frames.csv", f"{LIDAR}.csv"} if mode == "folder" else set()
    ours = {"faults.txt", "uavbench.json"}  # written when the folder is kept
    assert names - OWN - ours == COMMON | frames | more
    loot = (folder / "loot.bin").read_text()
    words = set(loot.replace(",", " ").replace("[", " ").replace("]", " ").split())
    assert len(ground_truths) > 1000
    assert not words & ground_truths
    assert "7701" not in words
    assert "bias_x" not in loot.replace("gyro_bias_rad_s", "").replace("accel_bias_m_s2", "")
    for name in READINGS:
        rows = [line for line in loot.splitlines() if line.startswith(f"{name[:-4]},")] if mode == "stream" else (
            (folder / name).read_text().splitlines()[1:]
        )  # fmt: skip
        measured = read_table(sequence.folder / name, list(SENSORS[name[:-4]].measured))
        stamps = [int(row["stamp_ns"]) for row in measured if int(row["stamp_ns"]) <= int(sequence.stamps_ns[-1])]
        assert [int(row.split(",")[1 if mode == "stream" else 0]) for row in rows] == stamps
        first = rows[0].split(",")[2 if mode == "stream" else 1 :]
        assert first == [measured[0][column] for column in SENSORS[name[:-4]].measured]


def test_what_is_known_of_the_body_is_told(sequence, tmp_path):
    import tomllib

    program = tmp_path / "program.py"
    program.write_text("raise SystemExit(9)")
    tracker = External(command=(sys.executable, str(program)), mode="folder")
    track_external(tracker, sequence, rate_hz=15.0, seed=1, kept_folder=tmp_path / "kept")
    told = tomllib.loads((tmp_path / "kept" / "sensors.toml").read_text())
    np.testing.assert_array_equal(told["cam_from_body"], sequence.cam_from_body.matrix)
    assert set(told["sensors"]) == {name[:-4] for name in READINGS} | {LIDAR}
    for name, about in told["sensors"].items():
        rings = ["azimuth_rad", "range_00_m"]
        assert about["columns"] == (rings if name == LIDAR else list(SENSORS[name].measured))
    assert told["sensors"][LIDAR]["step_deg"] == 2.0 and "reflectance" not in told["sensors"][LIDAR]
    if "sensors" in sequence.info:
        assert told["sensors"]["imu"]["offset_m"] == [0.0, 0.02, 0.01]
        assert told["sensors"]["imu-bmi088"]["rate_hz"] == 400.0
        assert told["sensors"]["imu-bmi088"]["gyro_noise_rad_s_sqrt_hz"] == 2.443e-4


@dataclasses.dataclass(frozen=True)
class Greedy:
    """Keeps all that it is given."""

    given = []  # noqa: RUF012

    def start(self, structure, camera, cam_from_world, rng, *, body):
        self.given.extend([structure, camera, cam_from_world, rng, body])
        return self

    def sense(self, samples):
        self.given.append(samples)

    def track(self, image, stamp_ns):
        self.given.append(image)
        return TrackResult(status="lost")


def reached(value, seen):
    """Everything that attributes and items of a value lead to."""
    if id(value) in seen or isinstance(value, type) or callable(value):
        return
    seen[id(value)] = value
    names = set(getattr(value, "__dict__", ())) | {n for t in type(value).__mro__ for n in getattr(t, "__slots__", ())}
    if isinstance(value, np.random.Generator):
        names |= {"bit_generator"}
    if isinstance(value, np.random.BitGenerator):
        names |= {"seed_seq", "state"}
    if isinstance(value, np.random.SeedSequence):
        names |= {"entropy", "spawn_key"}
    if isinstance(value, np.ndarray):
        names |= {"base"}
    for name in names:
        reached(getattr(value, name, None), seen)
    if isinstance(value, dict) or hasattr(value, "items"):
        for pair in value.items():
            reached(list(pair), seen)
    elif isinstance(value, list | tuple | set | frozenset):
        for item in value:
            reached(item, seen)


def test_no_object_that_a_plug_in_gets_leads_to_the_truth(sequence, ground_truths):
    Greedy.given.clear()
    results = track_sequence(Greedy(), sequence, rate_hz=15.0, seed=7701)
    assert results.record["errors"] == []
    seen = {}
    reached(Greedy.given, seen)
    values = list(seen.values())
    assert not [v for v in values if isinstance(v, Sequence | Path)]
    assert not [v for v in values if isinstance(v, str) and str(sequence.folder) in v]
    assert not [v for v in values if isinstance(v, int) and v == 7701]
    true = {float(value) for value in ground_truths}
    for array in (v for v in values if isinstance(v, np.ndarray) and v.dtype == np.float64):
        assert not true & set(array.ravel().tolist())
    assert not [v for v in values if isinstance(v, float) and v in true]
    told = [samples for samples in Greedy.given if hasattr(samples, "items")]
    assert {name for samples in told for name in samples} == {name[:-4] for name in READINGS} | {LIDAR}


@pytest.mark.parametrize("kind", list(SENSORS))
def test_every_sensor_says_which_of_its_columns_are_measured(kind):
    assert SENSORS[kind].measured
    assert not [column for column in SENSORS[kind].measured if "bias" in column or "true" in column]
