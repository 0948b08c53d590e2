"""Scenes that cannot be, on the command line: each message names the file, the key, what is wrong, and what to do."""

import re
import subprocess
import sys

import pytest
from click.testing import CliRunner

from tests.bench.conftest import in_one_process
from uavbench.bench.cli.main import main

SUITE = """
title = "t"
rates_hz = [5.0]
[trackers]
hold = { kind = "hold" }
"""
SEQUENCE = """
[sequences.NAME]
structure = { kind = "box" }
environment = { kind = "indoor" }
camera = { width = 64, height = 48, horizontal_fov_deg = 75.0 }
flight.path = { kind = "orbit", distance_m = 0.9, height_m = 0.4, turns = 0.02, speed_m_s = 0.3 }
"""


def uavbench(*arguments, folder):
    words = [sys.executable, "-m", "uavbench.bench.cli.main", *map(str, arguments)]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (
            'cameras = [{ name = "right" }, { name = "right" }]',
            "sequences.box: cameras[1].name 'right': cameras[0] has this name already; give it another one",
        ),
        (
            "rate_hz = 900.0",
            "sequences.box.rate_hz: input should be less than or equal to 500, got 900.0",
        ),
        (
            'sensors = [{ kind = "imu" }, { kind = "lidar-2d", rate_hz = 800.0 }]',
            "sequences.box.sensors[1].rate_hz: input should be less than or equal to 500, got 800.0",
        ),
        (
            'sensors = [{ kind = "gnss", rate_hz = 800.0 }]',
            "sequences.box.sensors[0].rate_hz: input should be less than or equal to 500, got 800.0",
        ),
        ("rate_hz = 0.0", "sequences.box.rate_hz: input should be greater than 0, got 0.0"),
        ("rate_hz = 2.0", "rates_hz[0]: 5 Hz is more than the 2 Hz of sequence box-s0"),
    ],
)
def test_mistakes_in_the_file_are_told_before_anything_is_rendered(tmp_path, monkeypatch, lines, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text(SUITE + SEQUENCE.replace("NAME", "box") + lines)
    for words in ((), ("--dry-run",)):
        done = CliRunner().invoke(main, ["render", "bad.toml", "--out", "out", *words])
        assert (done.exit_code, done.stdout) == (2, "")
        assert done.stderr == f"uavbench: bad.toml: 1 mistake\n  {told}\n"
    assert not (tmp_path / "out").exists()


FLOWN = {
    "folded": (
        'camera = { width = 64, height = 48, distortion_model = "radtan", distortion = [-2.0, 0.0, 0.0, 0.0] }',
        r"sequence folded-s0: camera: the distortion folds over before pixel .*; lower its coefficients, .*",
    ),
    "unfound": (
        'flight.airframe = { kind = "file", path = "none.toml" }',
        r".*none.toml: no such file.*",
    ),
    "aimed": (
        'mount = { kind = "gimbal", mode = "target", target_m = [0.0, 0.0, -9.0], pitch_axis = { least_deg = -10.0 } }',
        r"sequence aimed-s0: camera camera: mount.target_m: the stops of pitch_axis, -10 to 60 degrees, keep it .*; "
        "widen the stops, or move the target or the path",
    ),
    "lidar": (
        'sensors = [{ kind = "imu" }, { kind = "lidar-3d", offset_m = [1.1, 0.0, -0.25] }]',
        r"sensors\[1\], lidar-3d: t = 0.00 s, at \(0.05, 0.00, 0.15\) m: it is inside the structure; change its "
        "offset_m, or plan the path further away",
    ),
    "low": (
        'sensors = [{ kind = "range-finder", offset_m = [0.0, 0.0, -0.8] }]',
        r"sensors\[0\], range-finder: t = 0.00 s, at .* it is under the floor; change its offset_m, or plan .*",
    ),
    "slow": (
        'sensors = [{ kind = "lidar-3d", rate_hz = 0.1 }]',
        r"sensors\[0\], lidar-3d: rate_hz 0.1: one reading takes 10 s, and the flight .* s; raise rate_hz, or fly .*",
    ),
    "gnss": (
        'sensors = [{ kind = "imu" }, { kind = "gnss", rate_hz = 0.2 }]',
        r"sensors\[1\], gnss: rate_hz 0.2: one reading takes 5 s, and the flight .* s; raise rate_hz, or fly longer",
    ),
    "late": (
        'cameras = [{ name = "right", offset_s = 9.0 }]',
        r"sequence late-s0: right: no frame is exposed in the .* s of the flight: its timeshift_cam_imu_s or offset_s "
        "leaves no time for two at rate_hz 15; lower it, or fly longer",
    ),
    "encoder": (
        'mount = { kind = "gimbal", encoder = { rate_hz = 0.3 } }',
        r"gimbal of camera: encoder.rate_hz 0.3: one reading takes .* s, and the flight .* s; raise rate_hz, or fly .*",
    ),
    "inside": (
        'cameras = [{ name = "right", mount = { offset_m = [1.1, 0.0, -0.25] } }]',
        r"sequence inside-s0: camera right: .* the camera is inside the structure; .*",
    ),
    "model": (
        'structure = { kind = "mesh", path = "none.obj" }',
        r".*none.obj: no such file.*",
    ),
    "walls": (
        'environment = { kind = "indoor", room_m = 2.2 }',
        r"sequence walls-s0: camera camera: t = .* a wall or the ceiling of the room, .* raise environment.room_m .*",
    ),
    "crowd": (
        'clutter = [{ kind = "people", density = 0.1, nearest_m = 1.0, furthest_m = 1.0000001 }]',
        r"sequence crowd-s0: clutter\[0\]: no room for object 1 of 1: .*; raise furthest_m, or lower nearest_m",
    ),
    "road": (
        'environment = { kind = "outdoor", site = { embankments = true } }',
        r"environment.site: embankments and markings need a structure that carries a road: a bridge",
    ),
    "own": (
        'clutter = [{ kind = "faulty:Faulty" }]',
        r"IndexError: list index out of range \(faulty.py:7 in build\)",
    ),
}
"""Sequences that only the flight shows to be impossible, and what is told about each."""


FAULTY = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Faulty:
    def build(self, bounds, rng):
        return [][0]
"""
SLOW = SUITE.replace("[5.0]", "[0.2]") + SEQUENCE.replace("NAME", "slow") + "rate_hz = 0.2\n"
"""Of a flight of some 2 s, frames 5 s apart."""


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Go to a folder of suites beside a user's plug-in."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "faulty.py").write_text(FAULTY)
    yield
    sys.modules.pop("faulty", None)


def sequence(name, lines):
    whole = SEQUENCE.replace("NAME", name)
    given = lines.partition(" = ")[0]
    kept = [line for line in whole.splitlines() if not (given and line.startswith(f"{given} ="))]
    return "\n".join([*kept, lines])


def test_a_frame_rate_slower_than_the_flight_is_told_with_the_file_and_the_key(tmp_path, own_folder):
    """A worker tells it as this process does, and where a plug-in of the user has failed."""
    (tmp_path / "bad.toml").write_text(SLOW + sequence("own", FLOWN["own"][0]))
    told = "rate_hz 0.2: one frame takes 5 s, and the flight .* s; raise rate_hz, or fly longer"
    dry = CliRunner().invoke(main, ["render", "bad.toml", "--out", "out", "--dry-run"])
    assert dry.exit_code == 2 and dry.stderr == "2 of 2 sequences cannot be made: slow, own; the reasons are above\n"
    assert any(re.fullmatch(f"slow: {told}", line) for line in dry.stdout.splitlines()), dry.stdout
    done = uavbench("render", "bad.toml", "--out", "out", "--jobs", "1", folder=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    slow, own = sorted((line for line in done.stderr.splitlines() if line.startswith("FAILED")), reverse=True)
    assert re.fullmatch(f"FAILED render slow-s0 of bad.toml: sequence slow-s0: camera: {told}", slow)
    assert re.fullmatch(f"FAILED render own-s0 of bad.toml: {FLOWN['own'][1]}", own)
    assert not (tmp_path / "out" / "sequences").exists()


def test_what_only_the_flight_shows_is_told_with_the_file_and_the_key(tmp_path, own_folder):
    parts = [sequence(name, lines) for name, (lines, _) in FLOWN.items()]
    (tmp_path / "bad.toml").write_text("\n".join([SUITE, *parts]))
    dry = CliRunner().invoke(main, ["render", "bad.toml", "--out", "out", "--dry-run"])
    assert dry.exit_code == 2
    assert dry.stderr.startswith(f"{len(FLOWN)} of {len(FLOWN)} sequences cannot be made: {', '.join(FLOWN)};")
    for name, (_, message) in FLOWN.items():
        told_dry = f"{name}: {message.removeprefix(f'sequence {name}-s0: ').removeprefix('gimbal of camera: ')}"
        assert any(re.fullmatch(told_dry, line) for line in dry.stdout.splitlines()), (told_dry, dry.stdout)
    done = in_one_process("render", "bad.toml", "--out", "out")
    assert done.exit_code == 2 and "Traceback" not in done.stderr
    told = [line for line in done.stderr.splitlines() if line.startswith("FAILED")]
    assert len(told) == len(FLOWN)
    for name, (_, message) in FLOWN.items():
        assert any(re.fullmatch(f"FAILED render {name}-s0 of bad.toml: {message}", line) for line in told), told
    assert not list((tmp_path / "out").glob("sequences/*"))
