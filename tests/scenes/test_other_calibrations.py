"""Calibrations of other tools: what a user is told about each, and that what is told gives the same pixels."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest

from uavbench.scenes.calibrations.camera_file import told_beside
from uavbench.scenes.calibrations.other_tools import own_name
from uavbench.scenes.camera import Camera
from uavbench.scenes.exports.colmap import camera_line
from uavbench.scenes.image_files import check_size
from uavbench.tracker.images.camera_doubts import doubts_of_camera
from uavbench.tracker.images.recorded_sequence import Files
from uavbench.trajectories.errors import UserError

KALIBR = "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  intrinsics: [125.6, 125.6, 79.5, 59.5]\n"
ROS = (
    "image_width: 160\ncamera_matrix:\n  rows: 3\n  data: [125, 0, 79, 0, 125, 59, 0, 0, 1]\n"
    "distortion_model: plumb_bob\ndistortion_coefficients:\n  data: [0, 0, 0, 0, 0]\nrectification_matrix:\n  rows: 3\n"
)
OPENCV = (
    "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [125, 0, 79, 0, 125, 59, 0, 0, 1]\n"
)
EUROC = "sensor_type: camera\nintrinsics: [458, 457, 367, 248]\ndistortion_coefficients: [-0.28, 0.07, 0.0, 0.0]\n"
OST = "# oST version 5.0 parameters\n[image]\nwidth\n160\n[narrow_stereo]\ncamera matrix\n125 0 79\n"
POINTS = np.array([[0.3, -0.2, 1.0], [-0.4, 0.25, 1.2], [0.05, 0.3, 0.9], [0.0, 0.0, 2.0]])


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("camchain.yaml", KALIBR, "is a chain of Kalibr, which is not read; .* pinhole-radtan"),
        ("camchain.toml", KALIBR, "is a chain of Kalibr"),
        (
            "ost.yaml",
            ROS,
            r"is a calibration of ROS, .* of camera_matrix \(K\); .* projection_matrix \(P\) is of rect",
        ),
        ("ost.ini", OST, "is a calibration of ROS"),
        (
            "calibration.yml",
            OPENCV,
            "is a file of OpenCV, .* if all others are 0; those of cv2.fisheye are",
        ),
        ("calibration.xml", '<?xml version="1.0"?>\n<opencv_storage>\n', "is a file of OpenCV"),
        ("calibration.json", '{"K": {"type_id": "opencv-matrix"}}', "is a file of OpenCV"),
        ("sensor.yaml", EUROC, "is a sensor of EuRoC"),
        ("cameras.txt", "# Camera list\n1 SIMPLE_RADIAL 160 120 125 80 60 0.1\n", "is a model of COLMAP, .* less 0.5"),
        ("cameras", "1 OPENCV_FISHEYE 160 120 125 125 80 60 0 0 0 0\n", "is a model of COLMAP"),
        ("transforms.json", '{"camera_model": "OPENCV", "fl_x": 125.0}', "is a dataset of nerfstudio, .* less 0.5"),
        ("blank.yaml", "a: b" + "\n" * 65536, "calibrations of other tools are not read"),
        ("cameras.bin", "\0\1", "is not read; convert .* --output_type TXT`.* less 0.5"),
        ("K.npy", "\x93NUMPY", "calibrations of other tools are not read; write a camera.toml"),
        ("camera.toml", "# plumb_bob\nwidth = 160\nfx 125\n", "not a readable TOML file: .* line 3"),
    ],
)
def test_each_tools_file_is_told_with_its_conventions(tmp_path: Path, name: str, text: str, told: str) -> None:
    (tmp_path / name).write_bytes(text.encode("latin-1"))
    with pytest.raises(UserError, match=rf"{name}: {told}"):
        Camera.load(tmp_path / name)


@pytest.mark.parametrize(
    ("model", "parameters", "own"),
    [
        ("SIMPLE_RADIAL", (125.0, 80.3, 60.2, -0.11), (125.0, 125.0, 80.3, 60.2, "radtan", (-0.11, 0.0, 0.0, 0.0))),
        ("OPENCV", (125.0, 126.0, 80.3, 60.2, -0.2, 0.05, 1e-3, -2e-3),
         (125.0, 126.0, 80.3, 60.2, "radtan", (-0.2, 0.05, 1e-3, -2e-3))),
        ("OPENCV_FISHEYE", (125.0, 126.0, 80.3, 60.2, 0.02, -0.01, 3e-3, 1e-3),
         (125.0, 126.0, 80.3, 60.2, "equidistant", (0.02, -0.01, 3e-3, 1e-3))),
        ("PINHOLE", (125.0, 126.0, 80.3, 60.2), (125.0, 126.0, 80.3, 60.2, "none", ())),
    ],
)  # fmt: skip
def test_what_is_told_about_colmap_gives_colmaps_pixels(
    model: str, parameters: tuple[float, ...], own: tuple[float, float, float, float, str, tuple[float, ...]]
) -> None:
    fx, fy, cx, cy, name, distortion = own
    colmap = pycolmap.Camera(model=model, width=160, height=120, params=parameters)
    assert own_name(model) == name
    camera = Camera(160, 120, fx, fy, cx - 0.5, cy - 0.5, name, distortion)
    np.testing.assert_allclose(camera.project(POINTS) + 0.5, colmap.img_from_cam(POINTS), atol=1e-9)


def test_what_is_told_about_opencv_gives_opencvs_pixels() -> None:
    K = np.array([[125.0, 0, 80.3], [0, 126.0, 60.2], [0, 0, 1]])
    d = np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.0, 0.0, 0.0])
    told = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, d)[0].reshape(-1, 2)
    camera = Camera(160, 120, K[0, 0], K[1, 1], K[0, 2], K[1, 2], "radtan", tuple(d[:5]))
    np.testing.assert_allclose(camera.project(POINTS), told, atol=1e-9)
    x, y = (POINTS[:, :2] / POINTS[:, 2:]).T  # Brown 1971, by hand
    r2 = x * x + y * y
    radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]))
    u = x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x)
    np.testing.assert_allclose(camera.project(POINTS)[:, 0], K[0, 0] * u + K[0, 2], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "own"),
    [
        ("Equidistant", "equidistant"), ("KANNALA-BRANDT4", "equidistant"), ("radial-tangential", "radtan"),
        ("Radial_Tangential", "radtan"), ("Plumb Bob", "radtan"), ("SIMPLE_PINHOLE", "none"), ("", "none"),
        ("omni", ""), ("FOV", ""), ("rational_polynomial", ""), ("thin_prism_fisheye", ""), ("full_opencv", ""),
    ],
)  # fmt: skip
def test_a_name_of_another_tool_is_known_however_it_is_written(name: str, own: str) -> None:
    assert own_name(name) == own
    with pytest.raises(ValueError, match=f'here it is "{own}"' if own else "calibrate with one of them"):
        Camera(160, 120, 125.0, 125.0, 79.5, 59.5, name)


@pytest.mark.parametrize(
    ("model", "distortion", "told"),
    [
        (
            "none",
            (0.0, 0.0, 0.0, 0.0),
            "takes 0 finite numbers, not 4; name their distortion_model, or give dist",
        ),
        ("radtan", (-0.2,), "takes 4 or 5 finite numbers, not 1; those that a calibration leaves out are 0"),
        ("radtan", (-0.2, 0.1, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0), "not 8; leave out the zeros behind the fifth"),
        ("radtan", (-0.2, 0.1, 0.0, 0.0, 0.01, 0.3, 0.0, 0.0), "not 8; more are of a rational, thin prism or tilted"),
        ("equidistant", (0.1,), "takes 4 finite numbers, not 1; those that"),
        ("radtan", (float("nan"),) * 4, r"distortion = \[nan, nan, nan, nan\]: must be finite numbers"),
    ],
)
def test_another_number_of_coefficients_says_what_to_do(model: str, distortion: tuple[float, ...], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Camera(160, 120, 125.0, 125.0, 79.5, 59.5, model, distortion)


def fisheye(folder: Path, f_px: float, distortion: tuple[float, ...]) -> Camera:
    Camera(640, 480, f_px, f_px, 319.5, 239.5, "equidistant", distortion).save(folder / "camera.toml")
    return Camera.load(folder / "camera.toml")


def test_a_fisheye_that_folds_over_within_the_image_is_told(tmp_path: Path) -> None:
    """Its angles end at 33 degrees, 115 px from the middle; pixels beyond are of no ray."""
    with pytest.raises(UserError, match=r"folds over before pixel \(320, 0\), which no ray .* k1, k2, k3, k4 of this"):
        fisheye(tmp_path, 300.0, (-1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("f_px", "distortion"),
    [(150.0, (-0.06, 0.0, 0.0, 0.0)), (250.0, (-0.3, 0.07, 0.001, 0.0)), (900.0, (-1.0, 0.0, 0.0, 0.0))],
    ids=["circle within the image", "strong", "folds beyond the image"],
)
def test_a_fisheye_that_reaches_its_image_is_read(tmp_path: Path, f_px: float, distortion: tuple[float, ...]) -> None:
    assert fisheye(tmp_path, f_px, distortion).distortion == distortion


def test_an_image_of_another_size_says_the_intrinsics_of_a_resized_one(tmp_path: Path) -> None:
    camera = Camera(640, 480, 500.0, 510.0, 300.25, 250.75)
    told = r"a.png: image is 320 x 240 px, .* fx = 250, fy = 255, cx = 149.875, cy = 125.125, and the same distortion"
    with pytest.raises(UserError, match=told):
        check_size(Path("a.png"), 320, 240, camera)
    with pytest.raises(UserError, match=r"a.png: image is 640 x 400 px, .* px; take the camera.toml of these images"):
        check_size(Path("a.png"), 640, 400, camera)
    image = np.zeros((480, 640))
    image[200:220, 300:340] = 1.0  # its middle is at (319.5, 209.5)
    small = cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
    middle = np.average(np.arange(320), weights=small.sum(axis=0))
    assert (319.5 - camera.cx) / camera.fx == pytest.approx((middle - 149.875) / 250.0, abs=1e-9)


@pytest.mark.parametrize(
    ("cx", "cy", "told"),
    [
        (320.0, 240.0, "are half of the image's size, as in COLMAP, .* subtract 0.5 from both"),
        (
            161.2,
            118.9,
            "in the middle of an image of 320 x 240 px, not of 640 x 480: are fx, .* before they were",
        ),
        (630.0, 485.0, "in the middle of an image of 1280 x 960 px"),
        (319.5, 239.5, ""),
        (330.0, 250.0, ""),
        (0.0, 480.0, ""),
    ],
)
def test_a_principal_point_of_another_convention_is_a_doubt(cx: float, cy: float, told: str) -> None:
    doubts = doubts_of_camera(Camera(640, 480, 500.0, 500.0, cx, cy))
    assert len(doubts) == bool(told)
    if told:
        (doubt,) = doubts
        assert re.search(told, doubt)


def test_a_camera_of_numpys_numbers_is_written_as_it_is(tmp_path: Path) -> None:
    """As cv2.calibrateCamera gives them."""
    K = np.array([[400.25, 0, 320], [0, 402.5, 240], [0, 0, 1]])
    size = np.array([640, 480])
    camera = Camera(
        size[0], size[1], K[0, 0], np.float32(402.5), K[0, 2], K[1, 2], "radtan", tuple(np.array([-0.1, 0, 0, 0])),
        response=np.float64(2.2),
    )  # fmt: skip
    camera.save(str(tmp_path / "camera.toml"))
    assert Camera.load(str(tmp_path / "camera.toml")) == camera
    assert "np." not in (tmp_path / "camera.toml").read_text() and "np." not in camera_line(camera)


def test_the_camera_of_a_rendered_sequence_has_its_rolling_shutter(tmp_path: Path) -> None:
    """Which `sequence.json` tells: whoever tracks its images as their own would take all rows for exposed at once."""
    camera = Camera(160, 121, 125.6, 125.6, 79.5, 59.5)
    main, right, other = (tmp_path / "rolled" / name / "camera.toml" for name in ("", "cameras/right", "cameras/other"))
    for file in (main, right, other):
        file.parent.mkdir(parents=True, exist_ok=True)
        camera.save(file)
    assert [Camera.load(file).readout_ms for file in (main, right)] == [0.0, 0.0]
    about: dict[str, object] = {"row_delay_ns": 1e5, "cameras": {"right": {"row_delay_ns": 2e5}}}
    (tmp_path / "rolled" / "sequence.json").write_text(json.dumps(about))
    assert [Camera.load(file).readout_ms for file in (main, right, other)] == pytest.approx([12.0, 24.0, 0.0])
    assert told_beside(main) == told_beside(right) == (tmp_path / "rolled" / "sequence.json",)
    source = Files(images_path=str(tmp_path / "none"), model_file="none.obj", camera_file=str(main))
    assert tmp_path / "rolled" / "sequence.json" in source.entering_files
    main.unlink()
    replace(camera, readout_ms=7.0).save(main)
    assert Camera.load(main).readout_ms == 7.0
    right.write_text(f"{right.read_text()}readout_ms = 0.0\n")
    assert Camera.load(right).readout_ms == 0.0


@pytest.mark.parametrize("text", ["[1, 2]", "{", '{"row_delay_ns": "fast"}', '{"row_delay_ns": 0}', '{"cameras": 3}'])
def test_a_file_of_another_tool_beside_a_camera_tells_nothing_of_its_shutter(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cameras" / "left" / "camera.toml"
    file.parent.mkdir(parents=True)
    for place in (tmp_path, file.parent):
        (place / "sequence.json").write_text(text)
    Camera(160, 120, 125.6, 125.6, 79.5, 59.5).save(file)
    assert Camera.load(file).readout_ms == 0.0 and told_beside(file) == ()
    (file.parent / "sequence.json").unlink()
    assert Camera.load(file).readout_ms == 0.0 and told_beside(file) == ()
