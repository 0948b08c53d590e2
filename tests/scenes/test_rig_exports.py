"""A rig in every format, read by foreign readers: all that is expected is made from the TOML and the flight's record.

Two cameras, one with distortion, which exposes later; a clock that is not that of the IMU; a range finder and a lidar;
in one of the two cases the main camera is on a gimbal.
"""

import json
import re
import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation, Slerp

from tests.hand_made import hand_made
from tests.scenes.test_bag_exports import matrix, ns, read
from tests.scenes.test_exports_by_own_readers import bodies, notes, numbers, rendered, stamps
from tests.scenes.views_of_exports import Views, bodies_of_euroc, picture, pinhole, views
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.trajectories.errors import UserError

NAMES = ["camera", "right"]
RIG = """
title = "t"
seeds = [4]
rates_hz = [20.0]
[trackers]
hold = { kind = "hold" }

[sequences.rig]
rate_hz = 20.0
structure = { kind = "box" }
environment = { kind = "indoor" }
mount = MOUNT
camera = { width = 160, height = 120, fx_px = 120.0, fy_px = 121.0, cx_px = 78.0, cy_px = 61.0 }
clock = { timeshift_cam_imu_s = 0.03 }
annotations = ["depth", "mask"]

[[sequences.rig.sensors]]
kind = "imu"
offset_m = [0.01, -0.02, 0.03]

[[sequences.rig.sensors]]
kind = "range-finder"
pitch_deg = -40.0
yaw_deg = 25.0
offset_m = [0.02, 0.0, -0.03]
noise_m = 0.0
far_noise_m = 0.0
resolution_m = 0.0001

[[sequences.rig.sensors]]
kind = "lidar-3d"
step_deg = 10.0
pitch_deg = -25.0
yaw_deg = 10.0
roll_deg = 8.0
offset_m = [0.03, -0.04, 0.06]
noise_m = 0.0
resolution_m = 0.0001

[sequences.rig.flight.path]
kind = "orbit"
distance_m = 0.9
height_m = 0.9
turns = 0.008
speed_m_s = 0.5
acceleration_m_s2 = 3.0

[[sequences.rig.cameras]]
name = "right"
mount = { pitch_deg = -40.0, yaw_deg = 9.0, roll_deg = -3.0, offset_m = [0.04, -0.06, 0.02] }
offset_s = 0.02

[sequences.rig.cameras.camera]
width = 144
height = 112
horizontal_fov_deg = 70.0
distortion_model = "radtan"
distortion = [-0.2, 0.05, 0.001, -0.002]
"""
FIXED = "{ pitch_deg = -43.0, yaw_deg = 6.0, roll_deg = 2.0, offset_m = [0.05, 0.06, -0.01] }"
GIMBAL = '{ kind = "gimbal", pitch_deg = -43.0, yaw_deg = 6.0, offset_m = [0.05, 0.06, -0.01] }'


@pytest.fixture(scope="module")
def fixed(tmp_path_factory):
    return rendered(tmp_path_factory.mktemp("fixed"), RIG.replace("MOUNT", FIXED))


@pytest.fixture(scope="module")
def gimbal(tmp_path_factory):
    return rendered(tmp_path_factory.mktemp("gimbal"), RIG.replace("MOUNT", GIMBAL))


@pytest.fixture(scope="module")
def at_once(tmp_path_factory):
    return rendered(tmp_path_factory.mktemp("once"), RIG.replace("MOUNT", FIXED).replace("offset_s = 0.02", ""))


def suite(folder: Path) -> dict:
    return tomllib.loads((folder.parent / "suite.toml").read_text())["sequences"]["rig"]


def exported(folder: Path, format: str, out: Path, camera: str = "camera", undistort: bool = False) -> Path:
    sequence = Sequence.load(folder)
    export(sequence if camera == "camera" else sequence.cameras[camera], format, out, undistort=undistort)
    return out


def asked(folder: Path, name: str) -> dict:
    said = suite(folder)
    return said if name == "camera" else next(each for each in said["cameras"] if each["name"] == name)


def turned(about: dict) -> np.ndarray:
    """Rotation of body from a sensor: to the left about z, then up about its y, then clockwise about its x."""
    angles = [about.get("yaw_deg", 0.0), -about.get("pitch_deg", 0.0), about.get("roll_deg", 0.0)]
    return Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()


def placed(rotation: np.ndarray, offset_m: list[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, offset_m
    return out


OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""A forward-looking camera's axes x right, y down, z forward, as columns in the body's x forward, y left, z up."""


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics as the TOML has them."""

    size: tuple[int, int]
    K: np.ndarray
    distortion: tuple[float, ...]


def lens(folder: Path, name: str) -> Lens:
    said = asked(folder, name)["camera"]
    w, h = said["width"], said["height"]
    f = w / 2 / np.tan(np.radians(said.get("horizontal_fov_deg", 90.0)) / 2)
    values = [
        said.get("fx_px", f),
        said.get("fy_px", f),
        said.get("cx_px", (w - 1) / 2),
        said.get("cy_px", (h - 1) / 2),
    ]
    return Lens((w, h), pinhole(*values), tuple(said.get("distortion", ())))


def stamps_of(folder: Path, name: str) -> list[int]:
    """Stamps by the camera's own clock: a period apart from the camera's own delay on, to the end of the flight."""
    period_ns, late_ns = round(1e9 / suite(folder)["rate_hz"]), round(asked(folder, name).get("offset_s", 0.0) * 1e9)
    return list(range(late_ns, stamps(folder / "flight.csv")[-1] - shift_ns(folder) + 1, period_ns))


def on_body(folder: Path, name: str) -> list[np.ndarray]:
    """Matrices of body from camera at each image: of a gimbal by the true angles of its joints."""
    mount = asked(folder, name)["mount"]
    if mount.get("kind") != "gimbal":
        return [placed(turned(mount) @ OPTICAL, mount["offset_m"])] * len(stamps_of(folder, name))
    angles = numbers(folder / "gimbal.csv", "true_yaw_rad", "true_roll_rad", "true_pitch_rad")
    at = {stamp: k for k, stamp in enumerate(stamps(folder / "gimbal.csv"))}
    out = []
    for stamp in imu_stamps_of(folder, name):
        yaw, roll, pitch = angles[at[stamp]]
        joints = Rotation.from_euler("ZXY", [yaw, roll, -pitch]).as_matrix()
        out.append(placed(turned({"yaw_deg": mount["yaw_deg"]}) @ joints @ OPTICAL, mount["offset_m"]))
    return out


def shift_ns(folder: Path) -> int:
    return round(suite(folder)["clock"]["timeshift_cam_imu_s"] * 1e9)


def imu_stamps_of(folder: Path, name: str) -> list[int]:
    """Stamps by the IMU's clock, which is the flight's: t_imu = t_cam + shift."""
    return [stamp + shift_ns(folder) for stamp in stamps_of(folder, name)]


def cameras_in_world(folder: Path, name: str) -> list[np.ndarray]:
    """World from camera at each image: the exposures are at rows of the flight's record."""
    flown = dict(zip(stamps(folder / "flight.csv"), bodies(folder / "flight.csv"), strict=True))
    poses = [flown[stamp] for stamp in imu_stamps_of(folder, name)]
    return [body @ mount for body, mount in zip(poses, on_body(folder, name), strict=True)]


def images_of(folder: Path, name: str) -> list[np.ndarray]:
    frames = folder / "frames" if name == "camera" else folder / "cameras" / name / "frames"
    return [picture(path) for path in sorted(frames.iterdir())]


@pytest.mark.parametrize("rig", ["fixed", "gimbal"])
@pytest.mark.parametrize("name", NAMES)
def test_the_toml_says_where_the_structure_is_in_the_images(rig, name, request):
    """What is expected below is right: the box's outline, by OpenCV and the TOML's numbers, is where its mask is."""
    folder = request.getfixturevalue(rig)
    lines = (folder / "model.obj").read_text().splitlines()
    corners = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=float)
    own, masks = lens(folder, name), folder / ("mask" if name == "camera" else f"cameras/{name}/mask")
    v, u = np.mgrid[: own.size[1], : own.size[0]]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    exactly = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    coefficients = np.array(own.distortion or [0.0] * 4)
    lit = cv2.undistortPoints(pixels, own.K, coefficients, P=own.K, criteria=exactly).reshape(-1, 2)
    for k, pose in enumerate(cameras_in_world(folder, name)):
        seen = (corners - pose[:3, 3]) @ pose[:3, :3] @ own.K.T
        beyond_px = outside(cv2.convexHull((seen[:, :2] / seen[:, 2:]).astype(np.float32)).reshape(-1, 2), lit)
        mask = cv2.imread(str(masks / f"{k:06d}.png"), cv2.IMREAD_GRAYSCALE).ravel() == 1
        assert mask.sum() > 800
        assert beyond_px[mask].max() < 0.1 and beyond_px[~mask].min() > -0.1


def outside(hull: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far in px points (n, 2) lie outside a convex outline (m, 2); negative inside."""
    along = np.roll(hull, -1, axis=0) - hull
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    normals *= -np.sign(np.einsum("ij,ij->i", normals, hull.mean(axis=0) - hull))[:, None]
    return np.einsum("nmj,mj->nm", points[:, None] - hull, normals).max(axis=1)


def check(found: Views, folder: Path, names: list[str], format: str) -> None:
    """All views are those of the TOML."""
    assert list(found) == names
    for name, of_camera in found.items():
        own, poses, stamps_ns = lens(folder, name), cameras_in_world(folder, name), stamps_of(folder, name)
        assert len(of_camera) == len(poses) == len(images_of(folder, name)) > 3
        for view, pose, stamp, image in zip(of_camera, poses, stamps_ns, images_of(folder, name), strict=True):
            assert view.stamp_ns == (None if format in ("bop", "colmap") else stamp)
            np.testing.assert_allclose(view.world_from_cam, pose, atol=1e-9)
            np.testing.assert_allclose(view.K, own.K, atol=1e-12)
            count = max(len(view.distortion), len(own.distortion))
            padded = [(*each, *[0.0] * count)[:count] for each in (view.distortion, own.distortion)]
            assert padded[0] == padded[1] and (view.model == "radtan" or not any(own.distortion))
            np.testing.assert_array_equal(view.image, image)


@pytest.mark.parametrize("rig", ["fixed", "gimbal"])
@pytest.mark.parametrize("format", ["euroc", "tum", "kitti", "bop", "mcap", "rosbag2", "colmap", "transforms"])
def test_every_view_of_every_format_is_that_of_the_toml(rig, format, request, tmp_path):
    folder = request.getfixturevalue(rig)
    if rig == "gimbal" and format == "euroc":
        with pytest.raises(UserError, match="camera 'camera' is on a gimbal"):
            exported(folder, format, tmp_path / "out")
        return
    found = views(exported(folder, format, tmp_path / "out"), format, NAMES)
    several = format in ("euroc", "mcap", "rosbag2", "colmap")
    check(found, folder, NAMES if several else NAMES[:1], format)
    if not several:
        assert "`right` is not included; this format has one camera" in notes(tmp_path / "out")


@pytest.mark.parametrize("format", ["euroc", "mcap"])
def test_ground_truth_of_the_body_is_the_flights_by_the_imus_clock(format, fixed, tmp_path):
    out = exported(fixed, format, tmp_path / "out")
    if format == "euroc":
        found = bodies_of_euroc(out)
    else:
        at = [(time, message.pose.pose) for time, message in read(out)["/odom"]]
        found = {time: matrix(pose.position, pose.orientation) for time, pose in at}
    exposed = {stamp for name in NAMES for stamp in imu_stamps_of(fixed, name)}
    flown = dict(zip(stamps(fixed / "flight.csv"), bodies(fixed / "flight.csv"), strict=True))
    assert list(found) == sorted({*flown, *exposed})
    np.testing.assert_allclose([*found.values()], [*flown.values()], atol=1e-9)


@pytest.mark.parametrize("rig", ["fixed", "gimbal"])
@pytest.mark.parametrize("format", ["transforms", "euroc", "mcap", "colmap"])
def test_the_other_camera_alone_is_that_of_the_toml_with_its_lens(rig, format, request, tmp_path):
    folder = request.getfixturevalue(rig)
    (found,) = views(exported(folder, format, tmp_path / "out", "right"), format, ["right"]).values()
    check({"right": found}, folder, ["right"], format)


@pytest.mark.parametrize("rig", ["fixed", "gimbal"])
def test_kittis_tr_is_the_lidar_in_the_camera_that_is_exported(rig, request, tmp_path):
    folder = request.getfixturevalue(rig)
    sensor = suite(folder)["sensors"][2]
    body_from_lidar = placed(turned(sensor), sensor["offset_m"])
    for name in NAMES:
        out = exported(folder, "kitti", tmp_path / name, name, undistort=True)
        rows = dict(line.split(maxsplit=1) for line in (out / "calib.txt").read_text().splitlines())
        fixed = name == "right" or rig == "fixed"
        assert ("Tr:" in rows) == fixed == (out / "velodyne").is_dir()
        if fixed:
            expected = np.linalg.inv(on_body(folder, name)[0]) @ body_from_lidar
            found = np.array(rows["Tr:"].split(), dtype=float).reshape(3, 4)
            np.testing.assert_allclose(found, expected[:3], atol=1e-12)


@pytest.mark.parametrize("format", ["tum", "kitti", "bop", "mcap", "colmap", "transforms", "euroc"])
def test_undistorted_views_are_those_of_the_pinhole_with_the_same_matrix(format, fixed, tmp_path):
    if format in ("tum", "kitti", "bop"):
        with pytest.raises(UserError, match="cannot represent; add --undistort"):
            exported(fixed, format, tmp_path / "held", "right")
    (found,) = views(exported(fixed, format, tmp_path / "out", "right", undistort=True), format, ["right"]).values()
    own, poses, stamps_ns = lens(fixed, "right"), cameras_in_world(fixed, "right"), stamps_of(fixed, "right")
    for view, pose, stamp, image in zip(found, poses, stamps_ns, images_of(fixed, "right"), strict=True):
        assert view.stamp_ns in (None, stamp) and not any(view.distortion)
        np.testing.assert_allclose(view.world_from_cam, pose, atol=1e-9)
        np.testing.assert_allclose(view.K, own.K, atol=1e-12)
        expected = cv2.undistort(image, own.K, np.array(own.distortion))
        assert np.abs(view.image.astype(int) - expected)[2:-2, 2:-2].mean() < 1.0
        assert np.abs(view.image.astype(int) - image)[2:-2, 2:-2].mean() > 2.0
    assert "are undistorted (radtan [-0.2, 0.05, 0.001, -0.002])" in notes(tmp_path / "out")


DEPTHS = [("tum", "depth", 5000.0), ("bop", "test/000001/depth", 1000.0), ("transforms", "depths", 1000.0)]
"""Formats with depth: its folder, and its units per metre."""


@pytest.mark.parametrize("format", ["tum", "bop", "transforms"])
def test_depths_are_metres_along_the_optical_axis(format, fixed, tmp_path):
    """Of the box's points: each pixel of the box, by its depth and the TOML's camera, lies on a face of the box."""
    out = exported(fixed, format, tmp_path / "out")
    where, units_per_m = {
        "tum": ("depth", 5000.0),
        "bop": ("test/000001/depth", 0.0),
        "transforms": ("depths", 1000.0),
    }[format]
    if format == "bop":
        scale_mm = json.loads((out / "test/000001/scene_camera.json").read_text())["0"]["depth_scale"]
        units_per_m = 1000.0 / scale_mm
    own = lens(fixed, "camera")
    for k, (path, pose) in enumerate(
        zip(sorted((out / where).iterdir()), cameras_in_world(fixed, "camera"), strict=True)
    ):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert depth.dtype == np.uint16
        mask = cv2.imread(str(fixed / "mask" / f"{k:06d}.png"), cv2.IMREAD_GRAYSCALE)
        v, u = np.nonzero(cv2.erode((mask == 1).astype(np.uint8), np.ones((3, 3))))
        rays = np.column_stack([u, v, np.ones(len(u))]) @ np.linalg.inv(own.K).T
        points = (depth[v, u] / units_per_m)[:, None] * rays @ pose[:3, :3].T + pose[:3, 3]
        assert len(points) > 1000 and np.abs(off_the_box(points)).max() < 0.001


@pytest.mark.parametrize(("format", "where", "units_per_m"), DEPTHS)
def test_undistorted_depths_are_those_of_their_own_pixels(format, where, units_per_m, fixed, tmp_path):
    """On the box and the floor beneath it, by the pinhole: between pixels of the recorded image, not beside them."""
    out = exported(fixed, format, tmp_path / "out", "right", undistort=True)
    own = lens(fixed, "right")
    for path, pose in zip(sorted((out / where).iterdir()), cameras_in_world(fixed, "right"), strict=True):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        v, u = np.nonzero(depth)
        rays = np.column_stack([u, v, np.ones(len(u))]) @ np.linalg.inv(own.K).T
        points = (depth[v, u] / units_per_m)[:, None] * rays @ pose[:3, :3].T + pose[:3, 3]
        low = points[:, 2] < 0.2  # walls are elsewhere
        off_m = np.minimum(np.abs(off_the_box(points[low])), np.abs(points[low, 2]))
        assert low.sum() > 3000 and np.quantile(off_m, 0.9) < 0.001


def off_the_box(points: np.ndarray) -> np.ndarray:
    """Signed distance in m of points (n, 3) from the suite's box: 0.4 by 0.3 by 0.3 m, in the middle of the floor."""
    beyond = np.abs(points - [0, 0, 0.15]) - [0.2, 0.15, 0.15]
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


@pytest.mark.parametrize("format", ["mcap", "rosbag2"])
def test_bags_have_the_mounts_of_the_toml_and_the_encoders_readings(format, gimbal, tmp_path):
    messages = read(exported(gimbal, format, tmp_path / "out"))
    ((_, message),) = messages["/tf_static"]
    still = {
        each.child_frame_id: matrix(each.transform.translation, each.transform.rotation) for each in message.transforms
    }
    assert set(still) == {"imu_link", "right_optical_frame", "range_finder_link", "lidar_3d_link"}
    np.testing.assert_allclose(
        still["imu_link"], placed(np.eye(3), suite(gimbal)["sensors"][0]["offset_m"]), atol=1e-15
    )
    np.testing.assert_allclose(still["right_optical_frame"], on_body(gimbal, "right")[0], atol=1e-12)
    moving = [each for _, message in messages["/tf"] for each in message.transforms]
    aimed = [each for each in moving if each.child_frame_id == "camera_optical_frame"]
    assert [ns(each.header) for each in aimed] == imu_stamps_of(gimbal, "camera")
    for each, pose in zip(aimed, on_body(gimbal, "camera"), strict=True):
        np.testing.assert_allclose(matrix(each.transform.translation, each.transform.rotation), pose, atol=1e-9)
    joints = messages["/gimbal/joint_states"]
    assert [ns(each.header) for _, each in joints] == stamps(gimbal / "gimbal.csv")
    found = [
        [dict(zip(each.name, each.position, strict=True))[f"gimbal_{n}"] for n in ("yaw", "roll", "pitch")]
        for _, each in joints
    ]
    np.testing.assert_array_equal(found, numbers(gimbal / "gimbal.csv", "yaw_rad", "roll_rad", "pitch_rad"))


def test_kalibrs_chain_is_that_of_the_toml(fixed, gimbal, tmp_path):
    """T_cn_cnm1 and T_cam_imu map points into the camera (Kalibr's wiki, "Yaml formats")."""
    out = exported(fixed, "kalibr", tmp_path / "out")
    chain = yaml.safe_load((out / "camchain-imucam.yaml").read_text())
    body_from_imu = placed(np.eye(3), suite(fixed)["sensors"][0]["offset_m"])
    first, second = (np.linalg.inv(on_body(fixed, name)[0]) for name in NAMES)
    assert list(chain) == ["cam0", "cam1"] and "T_cn_cnm1" not in chain["cam0"]
    np.testing.assert_allclose(chain["cam1"]["T_cn_cnm1"], second @ np.linalg.inv(first), atol=1e-12)
    for key, name, cam_from_body in zip(chain, NAMES, (first, second), strict=True):
        said, own = chain[key], lens(fixed, name)
        np.testing.assert_allclose(said["T_cam_imu"], cam_from_body @ body_from_imu, atol=1e-12)
        assert said["timeshift_cam_imu"] == suite(fixed)["clock"]["timeshift_cam_imu_s"]
        assert (said["camera_model"], said["distortion_model"]) == ("pinhole", "radtan")
        assert said["distortion_coeffs"] == list(own.distortion or (0.0,) * 4)
        np.testing.assert_allclose(pinhole(*said["intrinsics"]), own.K, atol=1e-12)
        assert (said["resolution"], said["rostopic"]) == (list(own.size), f"/{name}/image_raw")
        assert said["cam_overlaps"] == [1 - NAMES.index(name)]
    with pytest.raises(UserError, match="camera 'camera' is on a gimbal"):
        exported(gimbal, "kalibr", tmp_path / "none")


def test_kalibrs_files_are_listed_and_an_offset_that_is_none_is_named(fixed, tmp_path):
    out = exported(fixed, "kalibr", tmp_path / "out")
    assert {path.name for path in out.glob("*.yaml")} == {"camchain-imucam.yaml", "imu0.yaml"}
    assert all(f"- `{path.name}`: " in (out / "README.md").read_text() for path in out.glob("*.yaml"))
    path = hand_made(shutil.copytree(fixed, tmp_path / "broken")) / "sequence.json"
    info = json.loads(path.read_text())
    info["sensors"]["imu.csv"]["offset_m"] = "x"
    path.write_text(json.dumps(info))
    with pytest.raises(UserError, match=re.escape(f"{path}: offset_m of imu.csv: ")):
        exported(tmp_path / "broken", "kalibr", tmp_path / "none")


def test_kalibrs_topics_are_those_of_the_bag_that_is_exported_with_it(fixed, tmp_path):
    """Undistorted images have topics of another name."""
    for undistort in (False, True):
        chain = exported(fixed, "kalibr", tmp_path / f"kalibr-{undistort}", undistort=undistort)
        bag = read(exported(fixed, "mcap", tmp_path / f"bag-{undistort}", undistort=undistort))
        said = yaml.safe_load((chain / "camchain-imucam.yaml").read_text()).values()
        assert {each["rostopic"] for each in said} <= set(bag)
        assert yaml.safe_load((chain / "imu0.yaml").read_text())["rostopic"] in bag


def test_colmaps_rig_of_cameras_that_expose_at_once_is_that_of_the_toml(at_once, tmp_path):
    out = exported(at_once, "colmap", tmp_path / "out")
    ((first, second),) = [each["cameras"] for each in json.loads((out / "rig_config.json").read_text())]
    assert (first, second["image_prefix"]) == ({"image_prefix": "camera/", "ref_sensor": True}, "right/")
    w, *xyz = second["cam_from_rig_rotation"]
    found = placed(Rotation.from_quat([*xyz, w]).as_matrix(), second["cam_from_rig_translation"])
    one, two = (np.linalg.inv(on_body(at_once, name)[0]) for name in NAMES)
    np.testing.assert_allclose(found, two @ np.linalg.inv(one), atol=1e-12)
    check(views(out, "colmap", NAMES), at_once, NAMES, "colmap")


@pytest.mark.parametrize("name", NAMES)
def test_a_video_has_every_image_at_the_rate_of_the_toml(name, fixed, tmp_path):
    film = cv2.VideoCapture(str(exported(fixed, "video", tmp_path / "out", name) / "video.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == suite(fixed)["rate_hz"]
    frames = []
    while (read_frame := film.read())[0]:
        frames.append(read_frame[1].astype(float))
    for frame, image in zip(frames, images_of(fixed, name), strict=True):
        assert frame.shape == image.shape and np.abs(frame - image).mean() < 8
    assert "Poses and camera are not included" in notes(tmp_path / "out")


@pytest.mark.parametrize("format", sorted(EXPORTS))
def test_what_a_format_cannot_hold_of_the_rig_is_told(format, fixed, tmp_path):
    """Each file of readings, the offset of the clocks, and stamps: either held, or named where a user reads it."""
    out = exported(fixed, format, tmp_path / "out")
    readme = next(path for path in (out / "README.md", out / "dataset_info.md") if path.is_file()).read_text()
    assert all(f"- {line}" in readme.splitlines() for line in json.loads((out / "export.json").read_text())["not_held"])
    files = {"imu.csv", "range-finder.csv", "lidar-3d.npy"}
    held = {"euroc": {"imu.csv"}, "mcap": files, "rosbag2": files, "kitti": {"lidar-3d.npy"}}.get(format, set())
    for file in files:
        told = f"`{file}`" if format == "kalibr" else f"Sensor readings: `{file}` ("
        assert (told in notes(out)) == (file not in held)
    assert ("t_imu = t_cam + 0.03 s" in notes(out)) == (format != "kalibr")
    assert ("have no time stamps" in notes(out)) == (format in ("bop", "colmap"))


@pytest.mark.parametrize("format", ["tum", "kitti", "bop", "video", "colmap", "transforms"])
def test_the_motion_of_a_gimbal_that_is_not_held_is_told(format, gimbal, tmp_path):
    out = exported(gimbal, format, tmp_path / "out")
    assert "(`mounts.csv`) is not included" in notes(out) and "`gimbal.csv` (gimbal) is not included" in notes(out)


def body_at(folder: Path, stamps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 3, 3) and positions (n, 3) of the body between the rows of the flight's record."""
    at, flown = np.array(stamps(folder / "flight.csv")), bodies(folder / "flight.csv")
    rotations = Slerp(at, Rotation.from_matrix(flown[:, :3, :3]))(stamps_ns).as_matrix()
    return rotations, np.column_stack([np.interp(stamps_ns, at, column) for column in flown[:, :3, 3].T])


def in_world(folder: Path, sensor: dict, stamps_ns: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of a sensor in m, each at its stamp."""
    rotations, positions = body_at(folder, stamps_ns)
    on_the_body = points @ turned(sensor).T + sensor["offset_m"]
    return np.einsum("nij,nj->ni", rotations, on_the_body) + positions


def test_ranges_are_metres_in_the_sensors_axes_of_the_toml(fixed):
    """Points of the lidar and the range finder lie on the floor, the box, or a wall, far from both."""
    sensor = suite(fixed)["sensors"][2]
    table = np.load(fixed / "lidar-3d.npy")
    elevations = np.radians(np.arange(-15.0, 15.1, 2.0))
    on_box = on_floor = 0
    for k, e in enumerate(elevations):
        r, a = table[f"range_{k:02d}_m"], table["azimuth_rad"]
        points = r[:, None] * np.column_stack(
            [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.full(len(a), np.sin(e))]
        )
        known = np.isfinite(r) & (r < 1.5)
        world = in_world(fixed, sensor, table["stamp_ns"][known], points[known])
        box, floor = np.abs(off_the_box(world)) < 0.001, np.abs(world[:, 2]) < 0.001
        assert (box | floor).all()
        on_box, on_floor = on_box + int((box & ~floor).sum()), on_floor + int(floor.sum())
    assert on_box > 20 and on_floor > 20
    sensor = suite(fixed)["sensors"][1]
    ranges = numbers(fixed / "range-finder.csv", "range_m")
    points = ranges * [1.0, 0.0, 0.0]
    world = in_world(fixed, sensor, np.array(stamps(fixed / "range-finder.csv")), points)
    assert len(world) > 5 and (np.minimum(np.abs(off_the_box(world)), np.abs(world[:, 2])) < 0.001).all()
