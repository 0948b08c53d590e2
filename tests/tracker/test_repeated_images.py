"""Images that are the one before again are told by `track --images`, `--bag` and recordings of a suite."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.bench.small_suites import own_images
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.images.image_levels import RepeatedImages
from uavbench.tracker.images.recorded_sequence import Files, RecordingSpec, record
from uavbench.tracker.images.track_images import track_images

RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (100, 4, 6, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("frames", "told"),
    [
        (range(100), ""),
        ([0, 0, 1, 2, 2, *range(3, 50), 50, 50], ""),
        ([*range(20), *[20] * 11, *range(21, 80)], "10 of 90 images are the one before again, to the last byte, as "
         "frames 20 to 30"),
        ([k // 2 for k in range(40)], "20 of 40 images are the one before again"),
        ([0, 0, 0], ""),
    ],
)  # fmt: skip
def test_a_camera_that_stopped_is_told(frames: list[int], told: str) -> None:
    seen = RepeatedImages()
    for frame in frames:
        seen.see(IMAGES[frame])
    said = seen.doubts("flight")
    assert bool(said) == bool(told) and all(f"flight: {told}" in line for line in said), said


def test_frozen_images_of_a_folder_are_told(tmp_path: Path) -> None:
    own_images(tmp_path)
    images = sorted((tmp_path / "frames").iterdir())
    for k in range(12):
        shutil.copy(images[-1], images[-1].with_name(f"{len(images) + k:06d}.png"))
    names = {"model": tmp_path / "model.obj", "camera": tmp_path / "camera.toml", "init": tmp_path / "init.toml"}
    found = track_images(Hold(), tmp_path / "frames", **names, out=tmp_path / "out", rate_hz=15.0)
    said = f"12 of {len(images) + 12} images are the one before again"
    assert any(said in doubt for doubt in found.record["doubts"])
    source = Files(images_path=str(tmp_path / "frames"), **{f"{name}_file": str(path) for name, path in names.items()})
    record(RecordingSpec(name="own", seed=0, source=source, rate_hz=15.0), tmp_path / "own", content_hash="a")
    doubts = json.loads((tmp_path / "own" / "sequence.json").read_text())["doubts"]
    assert any(said in doubt for doubt in doubts)
