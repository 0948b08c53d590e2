"""Suites so small that a test can run them."""

import shutil

from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence

SMALL = """
title = "small"
seeds = [0, 1]
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "studio" }
flight.path = { kind = "hand-pilot", duration_s = 0.3 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0 }
[trackers]
hold = { kind = "hold" }
"""

LOOP = '[loop]\nlatency = { kind = "constant", ms = 20.0 }\ncorridor_m = 0.4\ncoverage_px_m = 20.0\n'
FLOWN = (
    SMALL.replace('{ kind = "studio" }', '{ kind = "studio" }\nsensors = [{ kind = "imu" }]').replace(
        "seeds = [0, 1]", "seeds = [0]"
    )
    + 'truth = { kind = "truth" }\n'
    + LOOP
)
"""A flight in closed loop, on `truth` and on `hold`."""


RECORDING = """
[recordings.{name}]
rate_hz = {rate_hz}
[recordings.{name}.source]
kind = "files"
images_path = "frames"
model_file = "model.obj"
camera_file = "camera.toml"
init_file = "init.toml"
"""


OWN_IMAGES = """
title = "Our own images"
rates_hz = [15.0]
[recordings.own]
rate_hz = 15.0
[recordings.own.source]
kind = "files"
images_path = "frames"
model_file = "model.obj"
camera_file = "camera.toml"
init_file = "init.toml"
[trackers]
hold = { kind = "hold" }
"""
"""A suite of the files that `own_images` writes, beside it."""


def own_images(folder):
    """The bundled trial's images, model and camera as a user has them, with an initial pose."""
    shutil.copytree(TRIAL / "frames", folder / "frames")
    for name in ("model.obj", "camera.toml"):
        shutil.copy(TRIAL / name, folder / name)
    first = Sequence.load(TRIAL).true_cam_from_world(0)
    (folder / "init.toml").write_text(f"cam_from_model = {first.matrix.tolist()}\n")


def recorded_suite(folder, trackers):
    """File of two sequences of the bundled images, for tests that need no renderer."""
    own_images(folder)
    path = folder / "recorded.toml"
    recordings = "".join(RECORDING.format(name=name, rate_hz=hz) for name, hz in (("one", 15.0), ("two", 30.0)))
    path.write_text(f'title = "recorded"\nrates_hz = [15.0]\n{recordings}[trackers]\n{trackers}')
    return path


def small_suite(folder, more=""):
    """File of two short flights tracked by `hold`; `more` is added to its trackers."""
    path = folder / "small.toml"
    path.write_text(SMALL + more)
    return path
