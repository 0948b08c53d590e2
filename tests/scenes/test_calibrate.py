from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.scenes.conftest import FLAT_LIGHT, looking
from uavbench.scenes.calibration import calibrate, write_coverage
from uavbench.scenes.camera import Camera
from uavbench.scenes.image_files import ORIENTATION
from uavbench.scenes.rendering.camera_simulator import ideal_camera, render_camera
from uavbench.scenes.rendering.radiance import encode
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.structures.checkerboard import Checkerboard
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose, rotation_exp

BOARD = Checkerboard(square_m=0.025, lift_m=0.0)


def views(count: int) -> list[Pose]:
    """Poses that show the board near and far, aslant, turned, and in every corner of the image."""
    rng = np.random.default_rng(4)
    out = []
    for _ in range(count):
        eye = (float(rng.uniform(-0.22, 0.22)), -float(rng.uniform(0.34, 0.5)), float(rng.uniform(0.0, 0.30)))
        aim = (float(rng.uniform(-0.05, 0.05)), 0.0, 0.14 + float(rng.uniform(-0.05, 0.05)))
        roll = Pose(rotation_exp(np.array([0.0, 0.0, float(rng.uniform(-0.6, 0.6))])), np.zeros(3))
        out.append(roll @ looking(eye, aim))
    return out


def photographed(camera: Camera, folder: Path, count: int = 25, poses: list[Pose] | None = None) -> Path:
    pinhole, lens = render_camera(camera)
    poses = poses or views(count)
    parts = BOARD.build(np.random.default_rng(0)).parts
    with Renderer(parts, FLAT_LIGHT, pinhole.width, pinhole.height) as renderer:
        source = ideal_camera(renderer, camera, pinhole, lens, lambda k: poses[k])
        for k in range(count):
            image = source.image(k)
            assert image is not None
            cv2.imwrite(str(folder / f"{k:02d}.png"), encode(np.full_like(image, 0.1) * (image == 0) + 0.8 * image))
    return folder


def test_a_rendered_board_gives_the_focal_lengths_back_to_a_thousandth(tmp_path: Path) -> None:
    camera = Camera(640, 480, 520.0, 523.0, 322.0, 236.0, "radtan", (-0.21, 0.06, 0.0006, -0.0004))
    found = calibrate([photographed(camera, tmp_path)], (7, 8), 0.025)
    assert len(found.used) >= 20
    assert found.rms_px < 0.2
    assert found.camera.fx == pytest.approx(camera.fx, rel=1e-3)
    assert found.camera.fy == pytest.approx(camera.fy, rel=1e-3)
    assert found.camera.cx == pytest.approx(camera.cx, abs=1.0)
    assert found.camera.distortion[0] == pytest.approx(-0.21, abs=0.01)
    assert found.covered > 0.4
    write_coverage(found, tmp_path / "coverage.png")
    assert cv2.imread(str(tmp_path / "coverage.png")).shape == (480, 640, 3)


def turned(pictures: Path, turns: dict[int, int]) -> Path:
    """The pictures as JPEG with Exif data, by which those of these numbers are turned."""
    for number, path in enumerate(sorted(pictures.glob("*.png"))):
        exif = Image.Exif()
        exif[ORIENTATION] = turns.get(number, 1)
        Image.open(path).convert("RGB").save(path.with_suffix(".jpg"), quality=97, exif=exif.tobytes())
        path.unlink()
    return pictures


def test_pictures_that_their_exif_data_turn_differently_are_refused(tmp_path: Path) -> None:
    """Upside down, the principal point is at another place: with cx = 345 the focal length was 3.4 % off."""
    pictures = photographed(Camera(640, 480, 520.0, 523.0, 345.0, 236.0), tmp_path, 6)
    with pytest.raises(
        UserError, match=r"03.jpg: its Exif data turn it otherwise \(orientation 3\) than .*00.jpg \(1\)"
    ):
        calibrate([turned(pictures, {3: 3, 4: 3})], (7, 8), 0.025)


def test_pictures_that_are_all_turned_alike_are_calibrated(tmp_path: Path) -> None:
    pictures = photographed(Camera(640, 480, 520.0, 523.0, 345.0, 236.0), tmp_path, 8)
    found = calibrate([turned(pictures, dict.fromkeys(range(8), 3))], (7, 8), 0.025)
    assert found.camera.cx == pytest.approx(639 - 345, abs=2.0)


def test_a_fisheye_is_calibrated_with_its_own_model(tmp_path: Path) -> None:
    camera = Camera(640, 480, 400.0, 400.0, 319.5, 239.5, "equidistant", (-0.02, 0.01, 0.0, 0.0))
    found = calibrate([photographed(camera, tmp_path, 16)], (7, 8), 0.025, model="equidistant")
    assert found.camera.fx == pytest.approx(400.0, rel=5e-3)
    assert found.camera.distortion_model == "equidistant"


def test_corners_that_no_camera_fits_are_told(tmp_path: Path) -> None:
    """OpenCV finds small boards within larger ones, aslant, at another place in each picture."""
    pictures = photographed(Camera(640, 480, 520.0, 523.0, 322.0, 236.0), tmp_path, 8)
    with pytest.raises(UserError, match=r"no camera fits the corners: the reprojection error is \d.* check --board"):
        calibrate([pictures], (3, 3), 0.025)
    with pytest.raises(UserError, match="the calibration does not converge"):
        calibrate([pictures], (3, 3), 0.025, model="equidistant")
    with pytest.raises(UserError, match="give inner corners, as in 7x8, 3 or more along each side"):
        calibrate([pictures], (2, 2), 0.025)
    with pytest.raises(UserError, match="along each side, and at most 200"):
        calibrate([pictures], (99_999_999_999, 8), 0.025)


def test_boards_that_turn_too_little_are_told(tmp_path: Path) -> None:
    """Their corners fit a wrong camera as well as the right one: the reprojection error does not show it."""
    shifts = [(0.03 * x, -0.4 - 0.04 * (x + z), 0.14 + 0.02 * z) for x in (-1, 1) for z in (-1, 0, 1)]
    poses = [looking(eye, (eye[0], 0.0, eye[2])) for eye in shifts]
    pictures = photographed(Camera(640, 480, 520.0, 523.0, 322.0, 236.0), tmp_path, len(poses), poses)
    with pytest.raises(UserError, match=r"the board turns by \d\.\d deg at most .* no focal length"):
        calibrate([pictures], (7, 8), 0.025)


@pytest.mark.parametrize("count", [1, 59, 60, 61, 119, 120, 1000])
def test_at_most_sixty_pictures_are_taken_from_the_first_to_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    for k in range(count):
        (tmp_path / f"{k:04d}.png").touch()
    monkeypatch.setattr("uavbench.scenes.calibration._read", lambda *_: np.zeros((8, 8), dtype=np.uint8))
    monkeypatch.setattr("uavbench.scenes.calibration.find_corners", lambda *_: None)
    with pytest.raises(UserError, match=f"only 0 of {min(count, 60)} pictures"):
        calibrate([tmp_path], (7, 8), 0.025)


def test_pictures_without_a_board_are_told(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((240, 320), 90, dtype=np.uint8))
    with pytest.raises(UserError, match="only 0 of 3 pictures show the whole board of 7x8"):
        calibrate([tmp_path], (7, 8), 0.025)


def test_hidden_files_are_no_pictures(tmp_path: Path) -> None:
    (tmp_path / ".thumbnails").mkdir()
    for name in ("a.png", "._a.png", ".thumbnails/a.png", "b.pgm"):
        cv2.imwrite(str(tmp_path / name), np.full((240, 320), 90, dtype=np.uint8))
    with pytest.raises(UserError, match="only 0 of 2 pictures"):
        calibrate([tmp_path], (7, 8), 0.025)


def test_mixed_sizes_and_missing_files_are_told(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((240, 320), 90, dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.full((240, 300), 90, dtype=np.uint8))
    with pytest.raises(UserError, match=r"b.png: is 300 x 240 px"):
        calibrate([tmp_path], (7, 8), 0.025)
    with pytest.raises(UserError, match="no such file"):
        calibrate([tmp_path / "none"], (7, 8), 0.025)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("fx", '"500"', "fx = '500': must be a number of pixels"),
        ("cy", "true", "cy = True: must be a number of pixels"),
        ("cx", "[3]", r"cx = \[3\]: must be a number of pixels"),
        ("distortion_model", "[1]", r"distortion_model \[1\] is not one of none"),
        ("distortion_model", '"plumb_bob"', "distortion_model 'plumb_bob' is not one of .*; here it is \"radtan\""),
        ("distortion_model", '"OPENCV_FISHEYE"', 'distortion_model .* here it is "equidistant"'),
        (
            "distortion_model",
            '"rational_polynomial"',
            "distortion_model .* is not one of .*; calibrate with one of them, as `uavbench calibr",
        ),
        ("distortion", "5", "distortion = 5: must be a list of numbers"),
        ("distortion", '"12"', "distortion = '12': must be a list of numbers"),
        ("distortion", "[[0, 1, 2, 3]]", "distortion = .*: must be a list of numbers"),
        ("response", '"log"', "response = 'log': must be one of srgb, linear, unknown, or the positive exponent"),
        ("response", "0", "response = 0: must be one of srgb"),
        ("response", "-2.2", "response = -2.2: must be one of srgb"),
        ("response", "nan", "response = nan: must be one of srgb"),
        ("response", "true", "response = True: must be one of srgb"),
        ("response", "[2.2]", r"response = \[2.2\]: must be one of srgb"),
    ],
)
def test_a_camera_file_names_the_key_that_is_no_number(tmp_path: Path, key: str, value: str, message: str) -> None:
    values = {"width": "64", "height": "48", "fx": "50", "fy": "50.0", "cx": "31.5", "cy": "23.5"}
    path = tmp_path / "camera.toml"
    path.write_text("".join(f"{name} = {given}\n" for name, given in {**values, key: value}.items()))
    with pytest.raises(UserError, match=rf"camera\.toml: {message}"):
        Camera.load(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cx = 0.5\ncy = 0.49\n", "cx = 0.5, cy = 0.49 are shares of the image's size; give them in pixels"),
        (
            'cx = 31.5\ncy = 23.5\ndistortion_model = "radtan"\ndistortion = [-0.3, 0.1, -0.08, 0.001, 0.0]\n',
            "p1 = -0.08 and p2 = 0.001 are larger than those of any lens; the order is k1, k2, p1, p2, k3",
        ),
    ],
    ids=["shares", "order"],
)
def test_numbers_of_another_convention_are_told(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "camera.toml").write_text("width = 64\nheight = 48\nfx = 50\nfy = 50\n" + text)
    with pytest.raises(UserError, match=rf"camera\.toml: .*{told}"):
        Camera.load(tmp_path / "camera.toml")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.toml", "width = 2\nheight = 2\nfx = 3\nfy = 3\ncx = 0.5\ncy = 0.5\n"),
        ("camera.toml", "width = 64\nheight = 48\nfx = 50\nfy = 50\ncx = 0.0\ncy = 0.5\n"),
        ("camera.txt", "width = 64\nheight = 48\nfx = 50\nfy = 50\ncx = 31.5\ncy = 23.5\n"),
    ],
    ids=["tiny", "quarter of an image", "another suffix"],
)
def test_an_unusual_camera_in_pixels_is_taken_as_it_is(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    assert Camera.load(tmp_path / name).K[0, 2] in (0.5, 0.0, 31.5)


@pytest.mark.parametrize("response", ["srgb", "linear", "unknown", 2.2, 2])
def test_a_camera_file_says_its_response_unless_it_is_srgb(tmp_path: Path, response: str | float) -> None:
    camera = Camera(64, 48, 50.0, 50.0, 31.5, 23.5, "radtan", (0.0, 0.0, 0.0, 0.0), response=response)
    camera.save(tmp_path / "camera.toml")
    assert Camera.load(tmp_path / "camera.toml") == camera
    assert camera.without_distortion.response == response
    assert ("response" in (tmp_path / "camera.toml").read_text()) == (response != "srgb")
