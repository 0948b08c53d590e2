"""The pictures of the documentation: what they show is what the pages say, and nothing foreign is overwritten."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.gallery import docs_pictures
from uavbench.scenes.spec import CameraSpec
from uavbench.scenes.world.studio import Studio

ROOT = Path(__file__).parents[2]
GREEN = (60, 220, 70)


@pytest.fixture
def quick(monkeypatch):
    """Pictures of no content, on a system without Blender."""
    monkeypatch.setenv("UAVBENCH_BLENDER", "/nowhere/blender")
    monkeypatch.setattr(docs_pictures, "demo_picture", lambda scratch: np.full((8, 16, 3), 200, dtype=np.uint8))
    monkeypatch.setattr(docs_pictures, "stills_picture", lambda stills: np.full((8, 16, 3), 90, dtype=np.uint8))


def run(folder):
    return CliRunner().invoke(docs_pictures.main, [str(folder)], catch_exceptions=True)


def test_every_picture_of_the_pages_is_made_and_a_missing_blender_is_told(quick, tmp_path):
    done = run(tmp_path / "pictures")
    assert done.exit_code == 0, done.output
    assert "twin.jpg: not made" in done.stderr and "/nowhere/blender" in done.stderr
    made = {path.name for path in (tmp_path / "pictures").glob("*.jpg")}
    assert made | {"twin.jpg"} == {path.name for path in (ROOT / "docs" / "images").glob("*.jpg")}
    assert run(tmp_path / "pictures").exit_code == 0, "its own pictures are replaced"


def test_a_picture_that_it_did_not_make_stays(quick, tmp_path):
    (tmp_path / "demo.jpg").write_bytes(b"a photograph")
    assert run(tmp_path).exit_code != 0
    assert (tmp_path / "demo.jpg").read_bytes() == b"a photograph"
    assert [path.name for path in tmp_path.iterdir()] == ["demo.jpg"]


def test_the_twins_are_of_the_sequences_whose_results_are_told():
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    told = tomllib.loads(re.search(r"```toml twin.toml\n(.*?)```", page, re.S)[1])["sequences"]
    drawn = tomllib.loads(docs_pictures.FILE.read_text(encoding="utf-8"))["sequences"]
    assert {name: drawn[name] for name in docs_pictures.TWINS} == told


def test_every_view_is_of_a_sequence():
    named = {still.sequence for stills in docs_pictures.views().values() for still in stills}
    assert named | set(docs_pictures.TWINS) == set(docs_pictures.sequences())


def test_cameras_at_rest_stand_in_rows_of_two(monkeypatch):
    spec = replace(docs_pictures.sequences()["lived-in-building"], environment=Studio())
    spec = replace(spec, camera=CameraSpec(width=48, height=32))
    monkeypatch.setattr(docs_pictures, "sequences", lambda: {"building": spec})
    at = docs_pictures.Still("building", (-30.0, 0.0, 4.0), 0.0, 0.0)
    away = replace(at, bearing_deg=180.0)
    picture = docs_pictures.stills_picture([at, away, away, replace(at, elevation_deg=-60.0)]).astype(int)
    assert picture.shape == (64, 96, 3)
    tiles = [tile for row in np.split(picture, 2) for tile in np.split(row, 2, axis=1)]
    brightest = [tile.max() for tile in tiles]
    assert np.ptp(tiles[1]) == 0 and brightest[0] > brightest[1] + 50
    assert abs(np.nonzero(tiles[0].max(axis=2) > brightest[1] + 20)[1].mean() - 23.5) < 1, "ahead, hence in the middle"


def test_the_model_is_drawn_in_green_on_the_frames_of_the_flight(monkeypatch, tmp_path):
    monkeypatch.setattr(docs_pictures, "DEMO_FRAMES", (0, 2))
    monkeypatch.setattr(docs_pictures, "DEMO_S", 0.2)
    picture = docs_pictures.demo_picture(tmp_path)
    assert picture.shape == (360, 966, 3)
    assert (picture[:, 480:486] == 255).all()
    for tile in (picture[:, :480], picture[:, 486:]):
        green = (np.abs(tile.astype(int) - GREEN).max(axis=2) < 60).astype(np.uint8)
        outline, _ = cv2.findContours(green, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        inside = cv2.drawContours(np.zeros_like(green), outline, -1, 1, cv2.FILLED)
        box = (tile[..., 2].astype(int) - tile[..., 0] > 40).astype(np.uint8)  # brown on a grey carpet
        assert box.sum() > 3000 and (inside & box).sum() > 0.98 * box.sum()
