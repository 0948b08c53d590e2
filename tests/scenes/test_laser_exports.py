"""Range finders and lidars in bags and in KITTI's layout, read by foreign readers, are those of the TOML and the files.

Messages are decoded by mcap-ros2-support, clouds and scans by numpy as their formats define them; what is expected is
made from the TOML, `range-finder.csv` and the lidars' arrays.
"""

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tests.hand_made import hand_made
from tests.scenes.test_bag_exports import matrix, ns, read
from tests.scenes.test_exports_by_own_readers import bodies, cameras, notes, rendered, stamps, table
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import export
from uavbench.trajectories.errors import UserError

SUITE = """
title = "t"
seeds = [4]
rates_hz = [20.0]
[trackers]
hold = { kind = "hold" }

[sequences.lasers]
rate_hz = 20.0
structure = { kind = "box" }
environment = { kind = "indoor" }
mount = MOUNT
camera = { width = 96, height = 72, fx_px = 60.0, fy_px = 61.0, cx_px = 46.0, cy_px = 37.0 }
clock = { timeshift_cam_imu_s = 0.03 }
sensors = [
    { kind = "imu" },
    { kind = "range-finder", rate_hz = 80.0, pitch_deg = -40.0, yaw_deg = 25.0, offset_m = [0.02, 0.0, -0.03], EXACT, greatest_range_m = 4.0, far_m = 1.32 },
    { kind = "lidar-2d", rate_hz = 20.0, step_deg = 3.0, pitch_deg = -50.0, roll_deg = 12.0, offset_m = [0.0, 0.05, 0.04], EXACT, greatest_range_m = 3.0 },
    { kind = "lidar-2d", rate_hz = 25.0, step_deg = 6.0, field_deg = 180.0, elevations_deg = [-30.0], EXACT },
    { kind = "lidar-3d", rate_hz = 12.5, step_deg = 5.0, pitch_deg = -25.0, yaw_deg = 10.0, roll_deg = 8.0, offset_m = [0.03, -0.04, 0.06], elevations_deg = [-20.0, -5.0, 0.0, 12.0], least_range_m = 0.3, EXACT, greatest_range_m = 4.0 },
    { kind = "lidar-2d", rate_hz = 30.0, step_deg = 30.0, field_deg = 10.0, elevations_deg = [-50.0, -30.0], EXACT },
]

[sequences.lasers.flight.path]
kind = "orbit"
distance_m = 0.9
height_m = 0.9
turns = 0.02
speed_m_s = 0.5
acceleration_m_s2 = 3.0
"""  # noqa: E501
EXACT = "noise_m = 0.0, far_noise_m = 0.02, resolution_m = 0.0001"
FIXED = "{ pitch_deg = -43.0, yaw_deg = 6.0, roll_deg = 2.0, offset_m = [0.05, 0.06, -0.01] }"
PLANE, TILTED, RINGS, STILL = "lidar-2d.npy", "lidar-2d-2.npy", "lidar-3d.npy", "lidar-2d-3.npy"
SENSORS = {"range-finder.csv": 1, PLANE: 2, TILTED: 3, RINGS: 4, STILL: 5}
"""Files of readings, and rows of `sensors` in the TOML; STILL has one step a turn."""


def made(folder, mount=FIXED):
    return rendered(folder, SUITE.replace("MOUNT", mount).replace("EXACT", EXACT))


@pytest.fixture(scope="module")
def lasers(tmp_path_factory):
    return made(tmp_path_factory.mktemp("lasers"))


@pytest.fixture(scope="module", params=["mcap", "rosbag2"])
def bag(request, lasers, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param) / "out"
    export(Sequence.load(lasers), request.param, folder)
    return folder


@pytest.fixture(scope="module")
def messages(bag):
    return read(bag)


@pytest.fixture(scope="module")
def kitti(lasers, tmp_path_factory):
    folder = tmp_path_factory.mktemp("kitti") / "out"
    export(Sequence.load(lasers), "kitti", folder)
    return folder


def sensor(folder, file):
    suite = tomllib.loads((folder.parent / "suite.toml").read_text())["sequences"]["lasers"]
    return suite["sensors"][SENSORS[file]]


def on_body(about):
    """Matrix of body from a sensor: to the left about z, then up about its y, then clockwise about its x."""
    angles = [about.get("yaw_deg", 0.0), -about.get("pitch_deg", 0.0), about.get("roll_deg", 0.0)]
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    out[:3, 3] = about.get("offset_m", (0.0, 0.0, 0.0))
    return out


def turns(folder, file):
    """Rows of the array by turns, as many as the TOML's field and step give."""
    about, rows = sensor(folder, file), np.load(folder / file)
    field = about.get("field_deg", 270.0 if file == PLANE else 360.0)
    steps = round(field / about["step_deg"]) + (field < 360)
    assert len(rows) % steps == 0 and len(rows) > steps
    return rows.reshape(-1, steps)


def points_of(turn, about):
    """Points (rings, n, 3) of a turn, by the formula of docs/datasets.md."""
    a = turn["azimuth_rad"]
    e = np.radians(about.get("elevations_deg", [0.0]))[:, None]
    r = np.array([turn[f"range_{k:02d}_m"] for k in range(len(e))])
    return r[..., None] * np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e) * np.ones_like(a)], axis=-1)


def cloud(message):
    """Points (height, width) of a PointCloud2, by its own list of fields."""
    kinds = {7: "<f4", 4: "<u2"}
    names, offsets = [field.name for field in message.fields], [field.offset for field in message.fields]
    formats = [kinds[field.datatype] for field in message.fields]
    kind = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": message.point_step})
    assert all(field.count == 1 for field in message.fields) and not message.is_bigendian
    assert message.row_step == message.point_step * message.width
    return np.frombuffer(bytes(message.data), kind).reshape(message.height, message.width)


def test_ranges_are_those_of_the_file_with_the_limits_of_the_toml(lasers, messages):
    about = sensor(lasers, "range-finder.csv")
    cells = table(lasers / "range-finder.csv")["range_m"]
    found = messages["/range_finder/range"]
    assert [time for time, _ in found] == stamps(lasers / "range-finder.csv")
    seen = set()
    for cell, (time, said) in zip(cells, found, strict=True):
        assert (ns(said.header), said.header.frame_id) == (time, "range_finder_link")
        assert (said.radiation_type, said.field_of_view) == (1, 0.0)
        assert (said.min_range, said.max_range) == (np.float32(0.05), np.float32(about["greatest_range_m"]))
        assert np.float32(said.range) == np.float32(cell or "nan") or (not cell and np.isnan(said.range))
        far = not cell or float(cell) >= about["far_m"]
        assert said.variance == pytest.approx(0.02**2 if cell and far else 0.0)
        seen.add((bool(cell), far))
    assert {(True, True), (True, False)} <= seen


def test_a_range_that_is_none_is_nan_without_a_variance(lasers, tmp_path):
    folder = hand_made(shutil.copytree(lasers, tmp_path / "dark"))
    path = folder / "range-finder.csv"
    head, first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([head, f"{first.split(',')[0]},,", *rest]) + "\n")
    export(Sequence.load(folder), "mcap", tmp_path / "out")
    (_, none), (_, next_one), *_ = read(tmp_path / "out")["/range_finder/range"]
    assert np.isnan(none.range) and none.variance == 0.0 and np.isfinite(next_one.range)


def test_a_range_that_is_no_number_is_named_with_its_file(lasers, tmp_path):
    path = hand_made(shutil.copytree(lasers, tmp_path / "broken")) / "range-finder.csv"
    path.write_text(path.read_text().replace("\n0,", "\n0,far", 1))
    with pytest.raises(UserError, match=re.escape(f"{path}: line 2: range_m = 'far") + ".*is not a number, or nothing"):
        export(Sequence.load(path.parent), "mcap", tmp_path / "out")


def test_scans_of_a_level_ring_are_laser_scans(lasers, messages):
    about = sensor(lasers, PLANE)
    found = messages["/lidar_2d/scan"]
    for turn, (time, said) in zip(turns(lasers, PLANE), found, strict=True):
        assert (time, ns(said.header), said.header.frame_id) == (turn["stamp_ns"][0], time, "lidar_2d_link")
        steps = np.arange(len(turn))
        np.testing.assert_allclose(said.angle_min + steps * said.angle_increment, turn["azimuth_rad"], atol=1e-5)
        assert said.angle_max == pytest.approx(turn["azimuth_rad"][-1])
        np.testing.assert_allclose(time + 1e9 * steps * said.time_increment, turn["stamp_ns"], atol=1e2)
        assert said.scan_time == pytest.approx(1 / about["rate_hz"])
        assert (said.range_min, said.range_max) == (np.float32(0.1), np.float32(3.0))
        np.testing.assert_array_equal(np.float32(said.ranges), np.float32(turn["range_00_m"]))
        assert len(said.intensities) == 0
    assert any(np.isnan(said.ranges).any() for _, said in found)


@pytest.mark.parametrize("file", [TILTED, RINGS, STILL])
def test_turns_of_other_lidars_are_clouds_in_the_sensors_axes(lasers, messages, file):
    about, name = sensor(lasers, file), file.removesuffix(".npy").replace("-", "_")
    none = 0
    for turn, (time, said) in zip(turns(lasers, file), messages[f"/{name}/points"], strict=True):
        assert (time, ns(said.header), said.header.frame_id) == (turn["stamp_ns"][0], time, f"{name}_link")
        points = cloud(said)
        assert points.dtype.names == ("x", "y", "z", "ring", "time")
        assert points.shape == (len(about["elevations_deg"]), len(turn))
        xyz = np.stack([points[axis] for axis in "xyz"], axis=-1)
        np.testing.assert_allclose(xyz, points_of(turn, about), rtol=1e-6, atol=1e-6)
        assert (points["ring"] == np.arange(len(points))[:, None]).all()
        late = np.broadcast_to(turn["stamp_ns"] - time, points.shape)
        np.testing.assert_allclose(1e9 * points["time"].astype(float), late, atol=10)
        assert said.is_dense == bool(np.isfinite(xyz).all())
        none += not said.is_dense
    assert none or file != RINGS


def test_the_static_tree_has_the_places_of_the_toml(lasers, messages):
    ((_, message),) = messages["/tf_static"]
    found = {
        each.child_frame_id: matrix(each.transform.translation, each.transform.rotation) for each in message.transforms
    }
    assert all(each.header.frame_id == "base_link" for each in message.transforms)
    names = {f"{file.split('.')[0].replace('-', '_')}_link": file for file in SENSORS}
    assert set(found) == {"camera_optical_frame", "imu_link", *names}
    for link, file in names.items():
        np.testing.assert_allclose(found[link], on_body(sensor(lasers, file)), atol=1e-14)


def off_surfaces(points):
    """Distance in m of points (n, 3) from the box, 0.4 by 0.3 by 0.3 m, or the floor."""
    beyond = np.abs(points - [0, 0, 0.15]) - [0.2, 0.15, 0.15]
    box = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    return np.minimum(np.abs(box), np.abs(points[:, 2]))


def bodies_at(at, poses, stamps_ns):
    """Matrices (n, 4, 4) between poses at the stamps `at`."""
    out = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    out[:, :3, :3] = Slerp(at, Rotation.from_matrix(poses[:, :3, :3]))(stamps_ns).as_matrix()
    out[:, :3, 3] = np.column_stack([np.interp(stamps_ns, at, column) for column in poses[:, :3, 3].T])
    return out


def test_points_that_a_user_of_the_bag_places_by_its_transforms_lie_on_surfaces(messages):
    """Of nothing but the bag: each point from the pose of /tf at its time."""
    ((_, message),) = messages["/tf_static"]
    still = {
        each.child_frame_id: matrix(each.transform.translation, each.transform.rotation) for each in message.transforms
    }
    moving = [each for _, said in messages["/tf"] for each in said.transforms if each.child_frame_id == "base_link"]
    at = np.array([ns(each.header) for each in moving])
    poses = np.array([matrix(each.transform.translation, each.transform.rotation) for each in moving])
    on_box = 0
    for time, said in messages["/lidar_3d/points"]:
        points = cloud(said).reshape(-1)
        points = points[np.isfinite(points["x"])]
        when = np.minimum(time + 1e9 * points["time"].astype(float), at[-1])
        xyz = np.column_stack([points["x"], points["y"], points["z"], np.ones(len(points))])
        near = np.linalg.norm(xyz[:, :3], axis=1) < 1.6
        world = np.einsum("nij,nj->ni", bodies_at(at, poses, when) @ still["lidar_3d_link"], xyz)[near, :3]
        assert off_surfaces(world).max() < 0.001
        on_box += int((world[:, 2] > 0.01).sum())
    assert on_box > 20


def test_bags_tell_what_they_lack_of_the_lasers(bag):
    said = notes(bag)
    for file in SENSORS:
        assert f"those of `{file}` are rounded to float32" in said
        assert f"`{file}` (" not in said
    assert "intensities are not simulated, and the true ranges are not included" in said


def test_tr_is_the_lidar_in_the_camera_by_the_toml(lasers, kitti):
    rows = [line.split() for line in (kitti / "calib.txt").read_text().splitlines()]
    assert [row[0] for row in rows] == ["P0:", "P1:", "P2:", "P3:", "Tr:"]
    found = np.array(rows[-1][1:], dtype=float).reshape(3, 4)
    cam_from_body = np.array(json.loads((lasers / "sequence.json").read_text())["cam_from_body"])
    np.testing.assert_allclose(found, (cam_from_body @ on_body(sensor(lasers, RINGS)))[:3], atol=1e-12)


def scans_of_kitti(folder):
    return [np.fromfile(path, "<f4").reshape(-1, 4) for path in sorted((folder / "velodyne").iterdir())]


def test_a_scan_of_kitti_is_the_turn_nearest_to_its_image_as_the_lidar_is_then(lasers, kitti):
    about = sensor(lasers, RINGS)
    at = np.array(stamps(lasers / "flight.csv"))
    flown = bodies(lasers / "flight.csv")
    taken = turns(lasers, RINGS)
    body_from_lidar = on_body(about)
    at_images = bodies(lasers / "groundtruth.csv")
    images = np.array(stamps(lasers / "frames.csv")) + 30_000_000
    found = scans_of_kitti(kitti)
    assert [path.name for path in sorted((kitti / "velodyne").iterdir())] == [
        path.with_suffix(".bin").name for path in sorted((kitti / "image_2").iterdir())
    ]
    for scan, stamp, body in zip(found, images, at_images, strict=True):
        nearest = min(taken, key=lambda turn: abs((turn["stamp_ns"][0] + turn["stamp_ns"][-1]) / 2 - stamp))
        points = points_of(nearest, about)
        known = np.isfinite(points[..., 0])
        then = bodies_at(at, flown, np.minimum(nearest["stamp_ns"], at[-1])) @ body_from_lidar
        then, points = np.broadcast_to(then, (*known.shape, 4, 4))[known], points[known]
        world = np.einsum("nij,nj->ni", then[:, :3, :3], points) + then[:, :3, 3]
        now = np.linalg.inv(body @ body_from_lidar)
        np.testing.assert_allclose(scan[:, :3], world @ now[:3, :3].T + now[:3, 3], atol=5e-4)
        assert (scan[:, 3] == np.float32(0.3)).all()


def test_points_that_a_user_of_kitti_places_by_tr_and_poses_lie_on_surfaces(lasers, kitti):
    """x_world = pose Tr x, and P2 Tr x is where the image has it, as the benchmark's devkit defines both."""
    rows = {line.split()[0]: line.split()[1:] for line in (kitti / "calib.txt").read_text().splitlines()}
    tr, p2 = (np.array(rows[name], dtype=float).reshape(3, 4) for name in ("Tr:", "P2:"))
    poses = np.loadtxt(kitti / "poses.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, cameras(lasers)[:, :3], atol=1e-9)
    total = 0
    for pose, scan in zip(poses, scans_of_kitti(kitti), strict=True):
        x = np.column_stack([scan[:, :3], np.ones(len(scan))])
        in_camera = x @ tr.T
        world = in_camera @ pose[:, :3].T + pose[:, 3]
        near = np.linalg.norm(scan[:, :3], axis=1) < 1.6
        assert off_surfaces(world[near]).max() < 0.002
        total += int(near.sum())
        pixels = np.column_stack([in_camera, np.ones(len(x))]) @ p2.T
        assert (pixels[:, 2] == in_camera[:, 2]).all()
    assert total > 100


def test_kitti_tells_what_its_scans_are_and_which_sensors_it_lacks(kitti):
    said = notes(kitti)
    assert "nearest to it, its points moved to the time of the image by the true motion" in said
    assert "Reflectance is that of all surfaces, 0.3" in said and "no laser scanner" not in said
    assert f"`{RINGS}` (" not in said
    for file in ("imu.csv", "range-finder.csv", TILTED, PLANE):
        assert f"Sensor readings: `{file}` (" in said
    readme = (kitti / "README.md").read_text()
    assert "- `velodyne/`: scans of `lidar-3d.npy` by number" in readme and "px; Tr: camera from lidar, m" in readme


def test_without_a_fixed_camera_kitti_has_no_scans(tmp_path):
    folder = made(tmp_path, '{ kind = "gimbal", pitch_deg = -43.0 }')
    export(Sequence.load(folder), "kitti", tmp_path / "out")
    assert not (tmp_path / "out" / "velodyne").exists()
    assert "Tr" not in (tmp_path / "out" / "calib.txt").read_text()
    said = notes(tmp_path / "out")
    assert "Tr is one pose of the lidar in the camera, which a camera on a gimbal does not have" in said
    assert f"Sensor readings: `{RINGS}` (" in said and "no laser scanner" in said


@pytest.mark.parametrize(
    ("file", "key", "value", "told"),
    [
        (RINGS, "elevations_deg", [0.0], "elevations_deg: expected 4 numbers, one for each ring of the file"),
        (RINGS, "elevations_deg", "up", "elevations_deg: expected a list of numbers"),
        (PLANE, "rate_hz", None, "rate_hz: expected a number"),
        (PLANE, "pitch_deg", "down", "its place on the body: could not convert"),
        ("range-finder.csv", "far_m", [], "far_m: expected a number"),
    ],
)
def test_a_record_that_cannot_be_is_named_with_its_file_and_key(lasers, tmp_path, file, key, value, told):
    path = hand_made(shutil.copytree(lasers, tmp_path / "broken")) / "sequence.json"
    info = json.loads(path.read_text())
    info["sensors"][file] = {k: v for k, v in info["sensors"][file].items() if k != key}
    if value is not None:
        info["sensors"][file][key] = value
    path.write_text(json.dumps(info))
    with pytest.raises(UserError, match=re.escape(f"{path}: sensors: {file}: {told}")):
        export(Sequence.load(Path(tmp_path / "broken")), "mcap", tmp_path / "out")
    assert not (tmp_path / "out").exists()
