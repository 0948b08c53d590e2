"""Every number of every export, read by readers of this file's own, is that of the suite, the camera and the flight.

Nothing of the exporters, of `Sequence` or of `trajectory_files.formats` is used here: what is expected is made from the
TOML and the CSV, JSON and PNG files of the dataset.
"""

import csv
import json
import re
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.hand_made import hand_made
from uavbench.bench.config.suite import load_suite
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.scenes.generate import generate
from uavbench.trajectories.errors import UserError

HEAD = 'title = "t"\nseeds = [4]\nrates_hz = [5.0]\n[trackers]\nhold = { kind = "hold" }\n'
PATH = 'kind = "orbit", distance_m = 0.9, height_m = 1.0, turns = 0.02, speed_m_s = 0.5, acceleration_m_s2 = 3.0'
PLAIN = f"""{HEAD}
[sequences.plain]
rate_hz = 15.0
structure = {{ kind = "box" }}
environment = {{ kind = "outdoor" }}
mount = {{ pitch_deg = -33.0, yaw_deg = 6.0, roll_deg = 1.0, offset_m = [0.05, 0.02, -0.01] }}
flight.path = {{ {PATH} }}
camera = {{ width = 120, height = 90, fx_px = 80.0, fy_px = 81.0, cx_px = 58.0, cy_px = 44.0 }}
annotations = ["depth", "mask"]
sensors = [
    {{ kind = "baro" }},
    {{ kind = "imu-bmi088", rate_hz = 250.0, offset_m = [0.01, -0.02, 0.03], gyro_bias_rad_s = 0.02 }},
    {{ kind = "imu", rate_hz = 1000.0, accel_bias_m_s2 = 0.3, accel_walk_m_s3_sqrt_hz = 0.5 }},
]
"""
LENS = f"""{HEAD}
[sequences.lens]
rate_hz = 20.0
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
mount = {{ pitch_deg = -35.0 }}
flight.path = {{ {PATH} }}
effects = [{{ kind = "rolling-shutter", readout_ms = 9.0 }}, {{ kind = "drops", lost = 0.4, repeated = 0.2 }}]
annotations = ["depth", "mask"]

[sequences.lens.camera]
width = 120
height = 90
horizontal_fov_deg = 60.0
distortion_model = "MODEL"
distortion = COEFFICIENTS
"""


def rendered(folder: Path, text: str) -> Path:
    (folder / "suite.toml").write_text(text)
    (spec,) = load_suite(folder / "suite.toml").sequences
    generate(spec, folder / "sequence", content_hash="abc")
    return folder / "sequence"


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return rendered(tmp_path_factory.mktemp("plain"), PLAIN)


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    text = LENS.replace("MODEL", "radtan").replace("COEFFICIENTS", "[-0.2, 0.05, 0.001, -0.002]")
    return rendered(tmp_path_factory.mktemp("lens"), text)


def exported(folder: Path, format: str, out: Path, undistort: bool = False) -> Path:
    export(Sequence.load(folder), format, out / format, undistort=undistort)
    return out / format


def table(path: Path) -> dict[str, list[str]]:
    with path.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(path: Path, *names: str) -> np.ndarray:
    columns = table(path)
    return np.array([[float(value) for value in columns[name]] for name in names]).T


def stamps(path: Path) -> list[int]:
    return [int(text) for text in table(path)["stamp_ns"]]


def bodies(path: Path) -> np.ndarray:
    """Matrices (n, 4, 4) of world from body in a table of the dataset."""
    out = np.tile(np.eye(4), (len(stamps(path)), 1, 1))
    out[:, :3, :3] = Rotation.from_quat(numbers(path, "qx", "qy", "qz", "qw")).as_matrix()
    out[:, :3, 3] = numbers(path, "px_m", "py_m", "pz_m")
    return out


def cam_from_body(folder: Path) -> np.ndarray:
    return np.array(json.loads((folder / "sequence.json").read_text())["cam_from_body"])


def cameras(folder: Path) -> np.ndarray:
    """Matrices (n, 4, 4) of world from camera at each image."""
    return bodies(folder / "groundtruth.csv") @ np.linalg.inv(cam_from_body(folder))


def values(path: Path) -> list[list[str]]:
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [re.split(r"[ ,]+", line.strip()) for line in lines]


def yaml(path: Path) -> dict[str, object]:
    """The few constructs that a sensor.yaml has: words, numbers, lists, and T_BS."""
    found: dict[str, object] = {}
    for line in path.read_text().splitlines():
        key, _, value = line.split("#")[0].strip().partition(":")
        value = value.strip()
        if value.startswith("["):
            found[key] = [float(word) for word in value.strip("[]").split(",")]
        else:
            found[key] = float(value) if re.fullmatch(r"[-+0-9.e]+", value) else value
    return found


def nanoseconds(text: str) -> int:
    whole, _, rest = text.partition(".")
    return int(whole) * 10**9 + int(rest.ljust(9, "0"))


def poses(rows: list[list[str]], order: str) -> np.ndarray:
    """Matrices of rows of a position and a quaternion in an order such as xyzw."""
    numbers = np.array(rows, dtype=float)
    out = np.tile(np.eye(4), (len(rows), 1, 1))
    at = [3 + order.index(axis) for axis in "xyzw"]
    out[:, :3, :3], out[:, :3, 3] = Rotation.from_quat(numbers[:, at]).as_matrix(), numbers[:, :3]
    return out


def image(path: Path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found


def camera(folder: Path) -> dict[str, object]:
    return tomllib.loads((folder / "camera.toml").read_text())


def suite(folder: Path) -> dict:
    (found,) = tomllib.loads((folder.parent / "suite.toml").read_text())["sequences"].values()
    return found


def notes(folder: Path) -> str:
    return "\n".join(json.loads((folder / "export.json").read_text())["not_held"])


def test_euroc_camera(plain, tmp_path):
    cam = exported(plain, "euroc", tmp_path) / "mav0" / "cam0"
    said = suite(plain)
    sensor = yaml(cam / "sensor.yaml")
    asked = said["camera"]
    assert sensor["resolution"] == [asked["width"], asked["height"]]
    assert sensor["intrinsics"] == [asked[f"{name}_px"] for name in ("fx", "fy", "cx", "cy")]
    assert (sensor["distortion_model"], sensor["distortion_coefficients"]) == ("radial-tangential", [0.0] * 4)
    assert sensor["rate_hz"] == said["rate_hz"]
    body_from_cam = np.array(sensor["data"]).reshape(4, 4)
    np.testing.assert_allclose(body_from_cam, np.linalg.inv(cam_from_body(plain)), atol=1e-14)
    np.testing.assert_allclose(body_from_cam[:3, 3], said["mount"]["offset_m"], atol=1e-14)
    rows = values(cam / "data.csv")
    assert [int(stamp) for stamp, _ in rows] == stamps(plain / "frames.csv")
    for (_, name), original in zip(rows, table(plain / "frames.csv")["file"], strict=True):
        assert (image(cam / "data" / name) == image(plain / original)).all()


def test_euroc_ground_truth(plain, tmp_path):
    mav = exported(plain, "euroc", tmp_path) / "mav0"
    assert yaml(mav / "state_groundtruth_estimate0" / "sensor.yaml")["data"] == np.eye(4).ravel().tolist()
    rows = values(mav / "state_groundtruth_estimate0" / "data.csv")
    at = {int(row[0]): k for k, row in enumerate(rows)}
    found, state = poses([row[1:8] for row in rows], "wxyz"), np.array(rows, dtype=float)
    assert list(at) == sorted({*stamps(plain / "flight.csv"), *stamps(plain / "groundtruth.csv")})
    for name in ("flight.csv", "groundtruth.csv"):
        here = [at[stamp] for stamp in stamps(plain / name)]
        np.testing.assert_allclose(found[here], bodies(plain / name), atol=1e-14)
        np.testing.assert_array_equal(state[here, 8:11], numbers(plain / name, "vx_m_s", "vy_m_s", "vz_m_s"))
    axes = [f"{kind}_bias_{a}_{unit}" for kind, unit in (("gyro", "rad_s"), ("accel", "m_s2")) for a in "xyz"]
    biases, measured = numbers(plain / "imu-bmi088.csv", *axes), stamps(plain / "imu-bmi088.csv")
    both = [stamp for stamp in measured if stamp in at]
    assert len(both) > 10 and np.abs(biases[:, :3]).max() > 0.005
    exact = biases[[measured.index(stamp) for stamp in both]]
    np.testing.assert_allclose(state[[at[stamp] for stamp in both], 11:17], exact, atol=1e-15)


@pytest.mark.parametrize(("folder", "name", "number"), [("imu0", "imu-bmi088.csv", 1), ("imu1", "imu.csv", 2)])
def test_euroc_imus(plain, tmp_path, folder, name, number):
    imu = exported(plain, "euroc", tmp_path) / "mav0" / folder
    asked = suite(plain)["sensors"][number]
    defaults = json.loads((plain / "sequence.json").read_text())["config"]["sensors"][number]
    sensor = yaml(imu / "sensor.yaml")
    assert sensor["rate_hz"] == asked["rate_hz"]
    body_from_imu = np.array(sensor["data"]).reshape(4, 4)
    np.testing.assert_array_equal(body_from_imu[:3, :3], np.eye(3))
    assert body_from_imu[:3, 3].tolist() == asked.get("offset_m", [0.0, 0.0, 0.0])
    for key, parameter in (
        ("gyroscope_noise_density", "gyro_noise_rad_s_sqrt_hz"),
        ("gyroscope_random_walk", "gyro_walk_rad_s2_sqrt_hz"),
        ("accelerometer_noise_density", "accel_noise_m_s2_sqrt_hz"),
        ("accelerometer_random_walk", "accel_walk_m_s3_sqrt_hz"),
    ):
        assert sensor[key] == asked.get(parameter, defaults[parameter])
    assert yaml(imu.parent / "imu1" / "sensor.yaml")["accelerometer_random_walk"] == 0.5
    rows = values(imu / "data.csv")
    assert [int(row[0]) for row in rows] == stamps(plain / name)
    axes = [f"w{a}_rad_s" for a in "xyz"] + [f"a{a}_m_s2" for a in "xyz"]
    np.testing.assert_array_equal(np.array(rows, dtype=float)[:, 1:], numbers(plain / name, *axes))


def test_euroc_tells_what_it_does_not_hold(plain, tmp_path):
    out = exported(plain, "euroc", tmp_path)
    assert sorted(path.name for path in (out / "mav0").iterdir()) == [
        "cam0", "imu0", "imu1", "state_groundtruth_estimate0",
    ]  # fmt: skip
    for word in ("`baro.csv` (baro)", "`depth/`", "`mask/`", "imu1 (`imu.csv`)", "not at the body's origin"):
        assert word in notes(out)
        assert word in (out / "README.md").read_text()


def test_an_imu_that_the_record_does_not_describe_is_exported_and_told(plain, tmp_path):
    hand_made(shutil.copytree(plain, tmp_path / "older"))
    path = tmp_path / "older" / "sequence.json"
    info = json.loads(path.read_text())
    del info["sensors"]["imu.csv"]
    path.write_text(json.dumps(info))
    out = exported(tmp_path / "older", "euroc", tmp_path)
    rows = values(out / "mav0" / "imu1" / "data.csv")
    assert [int(row[0]) for row in rows] == stamps(plain / "imu.csv")
    assert "rate_hz" not in yaml(out / "mav0" / "imu1" / "sensor.yaml")
    assert "`imu.csv` is not described" in notes(out)
    for broken in ([], {"imu.csv": []}, {"imu.csv": {"offset_m": "x"}}, {"../imu.csv": {}}, {"no.csv": {}}):
        path.write_text(json.dumps(info | {"sensors": broken}))
        with pytest.raises(UserError):
            exported(tmp_path / "older", "euroc", tmp_path / "broken")


def test_tum(plain, tmp_path):
    tum = exported(plain, "tum", tmp_path)
    assert "# frame: world_from_cam" in (tum / "groundtruth.txt").read_text()
    rows = values(tum / "groundtruth.txt")
    assert [nanoseconds(row[0]) for row in rows] == stamps(plain / "groundtruth.csv")
    np.testing.assert_allclose(poses([row[1:] for row in rows], "xyzw"), cameras(plain), atol=1e-12)
    asked = suite(plain)["camera"]
    (intrinsics,) = values(tum / "camera.txt")
    said = [asked[name] for name in ("fx_px", "fy_px", "cx_px", "cy_px", "width", "height")]
    assert [float(word) for word in intrinsics] == said
    for kind in ("rgb", "depth"):
        listed = values(tum / f"{kind}.txt")
        assert [nanoseconds(stamp) for stamp, _ in listed] == stamps(plain / "frames.csv")
        assert {name for _, name in listed} == {f"{kind}/{path.name}" for path in (tum / kind).iterdir()}
    far = measured = 0
    for (_, rgb), (_, name), original in zip(
        values(tum / "rgb.txt"), values(tum / "depth.txt"), table(plain / "frames.csv")["file"], strict=True
    ):
        assert (image(tum / rgb) == image(plain / original)).all()
        units, true_mm = image(tum / name), image(plain / "depth" / Path(original).name).astype(int)
        assert units.dtype == np.uint16
        near = true_mm < 13107.01
        np.testing.assert_array_equal(units[near], 5 * true_mm[near])
        assert not units[~near].any()
        far, measured = far + int((~near).sum()), measured + int((true_mm > 0).sum())
    assert far > 0
    assert f"{100 * far / measured:.1f} % of the measured pixels are further away and are 0" in notes(tum)
    assert all(f"`{name}`" in notes(tum) for name in ("imu.csv", "imu-bmi088.csv", "baro.csv", "mask/"))
    assert "Annotations: `depth/`" not in notes(tum)


def test_kitti(plain, tmp_path):
    kitti = exported(plain, "kitti", tmp_path)
    found = np.tile(np.eye(4), (len(stamps(plain / "groundtruth.csv")), 1, 1))
    found[:, :3] = np.array(values(kitti / "poses.txt"), dtype=float).reshape(-1, 3, 4)
    np.testing.assert_allclose(found, cameras(plain), atol=1e-12)
    assert [nanoseconds(row[0]) for row in values(kitti / "times.txt")] == stamps(plain / "frames.csv")
    asked = suite(plain)["camera"]
    P = [asked["fx_px"], 0, asked["cx_px"], 0, 0, asked["fy_px"], asked["cy_px"], 0, 0, 0, 1, 0]
    rows = values(kitti / "calib.txt")
    assert [row[0] for row in rows] == ["P0:", "P1:", "P2:", "P3:"]
    assert all([float(word) for word in row[1:]] == P for row in rows)
    for k, original in enumerate(table(plain / "frames.csv")["file"]):
        assert (image(kitti / "image_2" / f"{k:06d}.png") == image(plain / original)).all()
    assert "the first one is not the identity" in notes(kitti)
    assert "P0 to P3" in notes(kitti)


def outline(folder: Path, pose: np.ndarray, K: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The convex outline of the model's vertices, with soft borders: 1 inside, 0 outside, between by a pixel."""
    lines = (folder / "model.obj").read_text().splitlines()
    points = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=float)
    seen = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(pose).T
    uv = (seen[:, :3] @ K.T)[:, :2] / seen[:, 2:3]
    hull = cv2.convexHull(uv.astype(np.float32))
    grid = [[cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u in range(shape[1])] for v in range(shape[0])]
    return np.array(grid)


def test_bop(plain, tmp_path):
    bop = exported(plain, "bop", tmp_path)
    scene, asked = bop / "test" / "000001", suite(plain)["camera"]
    K = np.array([[asked["fx_px"], 0, asked["cx_px"]], [0, asked["fy_px"], asked["cy_px"]], [0, 0, 1.0]])
    read = {name: json.loads((scene / f"scene_{name}.json").read_text()) for name in ("camera", "gt", "gt_info")}
    whole = json.loads((bop / "camera.json").read_text())
    assert [whole[name] for name in ("fx", "fy", "cx", "cy")] == [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
    assert (whole["width"], whole["height"], whole["depth_scale"]) == (120, 90, 1.0)
    for k, (pose, original) in enumerate(zip(cameras(plain), table(plain / "frames.csv")["file"], strict=True)):
        cam, (gt,), (info,) = (read[name][str(k)] for name in ("camera", "gt", "gt_info"))
        cam_from_world = np.linalg.inv(pose)
        for R, t in ((cam["cam_R_w2c"], cam["cam_t_w2c"]), (gt["cam_R_m2c"], gt["cam_t_m2c"])):
            np.testing.assert_allclose(np.array(R).reshape(3, 3), cam_from_world[:3, :3], atol=1e-12)
            np.testing.assert_allclose(t, 1000 * cam_from_world[:3, 3], atol=1e-9)
        assert gt["obj_id"] == 1
        np.testing.assert_array_equal(np.array(cam["cam_K"]).reshape(3, 3), K)
        assert (image(scene / "rgb" / f"{k:06d}.png") == image(plain / original)).all()
        depth = image(scene / "depth" / f"{k:06d}.png") * cam["depth_scale"]
        np.testing.assert_array_equal(depth, image(plain / "depth" / f"{k:06d}.png"))
        mask, visible = (image(scene / name / f"{k:06d}_000000.png") for name in ("mask", "mask_visib"))
        assert set(np.unique(mask)) | set(np.unique(visible)) <= {0, 255}
        np.testing.assert_array_equal(visible > 0, image(plain / "mask" / f"{k:06d}.png") == 1)
        assert (mask[visible > 0] > 0).all()
        inside = outline(plain, pose, K, mask.shape)
        assert (mask[inside > 1e-3] > 0).all() and not mask[inside < -1].any()
        rows, columns = np.nonzero(mask)
        assert info["bbox_obj"] == [columns.min(), rows.min(), np.ptp(columns), np.ptp(rows)]
        rows, columns = np.nonzero(visible)
        assert info["bbox_visib"] == [columns.min(), rows.min(), np.ptp(columns), np.ptp(rows)]
        assert info["px_count_all"] == (mask > 0).sum()
        assert info["px_count_visib"] == (visible > 0).sum()
        assert info["px_count_valid"] == ((mask > 0) & (depth > 0)).sum()
        assert info["visib_fract"] == pytest.approx(info["px_count_visib"] / info["px_count_all"])
    model = json.loads((bop / "models" / "models_info.json").read_text())["1"]
    assert [model[f"size_{a}"] for a in "xyz"] == pytest.approx([400, 300, 300])
    ply = (bop / "models" / "obj_000001.ply").read_text().split("end_header\n")[1].splitlines()
    points = {tuple(np.round(np.array(line.split(), dtype=float), 3)) for line in ply[:8]}
    assert points == {(x, y, z) for x in (-200.0, 200.0) for y in (-150.0, 150.0) for z in (0.0, 300.0)}
    targets = json.loads((bop / "test_targets_bop19.json").read_text())
    assert [target["im_id"] for target in targets] == list(range(len(cameras(plain))))
    assert "`imu.csv` (imu)" in (bop / "dataset_info.md").read_text()


def test_what_hides_the_structure_leaves_its_silhouette_in_bop(plain, tmp_path):
    """As if something stood before the right half of the box in the first image."""
    hand_made(shutil.copytree(plain, tmp_path / "hidden"))
    path = tmp_path / "hidden" / "mask" / "000000.png"
    mask = image(path)
    whole = int((mask == 1).sum())
    middle = int(np.nonzero(mask == 1)[1].mean())
    mask[:, middle:] = 3
    cv2.imwrite(str(path), mask)
    scene = exported(tmp_path / "hidden", "bop", tmp_path) / "test" / "000001"
    info = json.loads((scene / "scene_gt_info.json").read_text())["0"][0]
    assert info["px_count_visib"] == (mask == 1).sum() < 0.7 * whole
    assert info["px_count_all"] == pytest.approx(whole, rel=0.03)
    assert (image(scene / "mask" / "000000_000000.png") > 0).sum() == info["px_count_all"]
    assert info["bbox_visib"][0] + info["bbox_visib"][2] == middle - 1 < info["bbox_obj"][0] + info["bbox_obj"][2]


@pytest.mark.parametrize("format", ["tum", "kitti", "bop"])
def test_a_lens_is_refused_or_taken_out(lens, tmp_path, format):
    with pytest.raises(UserError, match=rf"which the format {format} cannot represent; add --undistort"):
        exported(lens, format, tmp_path)
    assert not (tmp_path / format).exists()
    out = exported(lens, format, tmp_path, undistort=True)
    said = notes(out)
    assert "the images are undistorted (radtan [-0.2, 0.05, 0.001, -0.002])" in said
    assert "rows are exposed 101124 ns apart" in said
    gaps = np.diff(stamps(lens / "frames.csv")) / 5e7
    lost = int(np.rint(gaps - 1).sum())
    assert lost > 0 and f"{lost} frames were lost" in said and "probability 0.2" in said


def test_undistorted_images_are_those_of_the_pinhole(lens, tmp_path):
    """OpenCV's own undistortion of the same image is the reference, and masks lie where the pinhole sees the box."""
    bop = exported(lens, "bop", tmp_path, undistort=True) / "test" / "000001"
    c = camera(lens)
    K = np.array([[c["fx"], 0, c["cx"]], [0, c["fy"], c["cy"]], [0, 0, 1.0]])
    for k, (pose, original) in enumerate(zip(cameras(lens), table(lens / "frames.csv")["file"], strict=True)):
        expected = cv2.undistort(image(lens / original), K, np.array(c["distortion"]))
        found = image(bop / "rgb" / f"{k:06d}.png")
        assert np.abs(found.astype(int) - expected)[2:-2, 2:-2].mean() < 1.0
        inside = outline(lens, pose, K, found.shape[:2])
        mask = image(bop / "mask" / f"{k:06d}_000000.png") > 0
        assert mask[inside > 1e-3].all() and not mask[inside < -1.5].any()


@pytest.mark.parametrize(
    ("model", "coefficients", "held"),
    [
        ("radtan", [-0.2, 0.05, 0.001, -0.002], True),
        ("radtan", [-0.2, 0.05, 0.001, -0.002, 0.01], False),
        ("equidistant", [0.01, 0.02, -0.01, 0.001], True),
    ],
)
def test_euroc_holds_a_lens_of_four_coefficients(lens, tmp_path, model, coefficients, held):
    sequence = Sequence.load(lens)
    text = (lens / "camera.toml").read_text().replace("radtan", model)
    (tmp_path / "camera.toml").write_text(re.sub(r"distortion = .*", f"distortion = {coefficients}", text))
    object.__setattr__(sequence, "camera", type(sequence.camera).load(tmp_path / "camera.toml"))
    if not held:
        with pytest.raises(UserError, match="cannot represent"):
            export(sequence, "euroc", tmp_path / "out")
        return
    export(sequence, "euroc", tmp_path / "out")
    sensor = yaml(tmp_path / "out" / "mav0" / "cam0" / "sensor.yaml")
    assert sensor["distortion_coefficients"] == coefficients
    assert sensor["distortion_model"] == {"radtan": "radial-tangential"}.get(model, model)


def test_what_a_sequence_does_not_know_is_left_out_of_bop(lens, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(lens, bare, ignore=shutil.ignore_patterns("mask", "depth"))
    bop = exported(bare, "bop", tmp_path, undistort=True)
    info = json.loads((bop / "test" / "000001" / "scene_gt_info.json").read_text())["0"][0]
    assert set(info) == {"bbox_obj", "px_count_all"}
    assert not (bop / "test" / "000001" / "mask_visib").exists()
    assert 'has no annotations = ["mask"]' in notes(bop)


@pytest.mark.parametrize("format", sorted(EXPORTS))
def test_every_export_says_what_it_is_and_what_it_lacks(plain, tmp_path, format):
    out = exported(plain, format, tmp_path)
    said = json.loads((out / "export.json").read_text())
    assert (said["format"], said["sequence"], said["content_hash"]) == (format, "plain-s4", "abc")
    assert set(said["frames"].values()) <= {"world_from_body", "world_from_cam"}
    assert all((out / name).is_file() for name in said["frames"])
    assert said["not_held"]
    assert any((out / name).is_file() for name in ("README.md", "dataset_info.md"))


@pytest.mark.parametrize("format", EXPORTS)
def test_a_folder_of_any_name_holds_the_whole_export(plain, tmp_path, format):
    odd = tmp_path / "run #1 100%25 ?a=b %04d \u56fe 'q' \"d\" & $x {y}"
    odd.mkdir()
    exported(plain, format, odd)
    exported(plain, format, tmp_path / "plain")

    def held(folder):
        return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}

    assert held(odd) == held(tmp_path / "plain")
    assert {path.name for path in tmp_path.iterdir()} == {odd.name, "plain"}


BAD_READINGS = {
    "unsorted": (lambda head, a, b, *rest: [head, b, a, *rest], "line 3: its stamp is not later"),
    "twice": (lambda head, a, b, *rest: [head, a, a, b, *rest], "line 3: its stamp is not later"),
    "NaN": (
        lambda head, a, *rest: [head, re.sub(",[^,]*", ",nan", a, count=1), *rest],
        "line 2: wx_rad_s = nan",
    ),
    "infinite": (lambda head, a, *rest: [head, re.sub(",[^,]*", ",inf", a, count=1), *rest], "line 2: wx_rad_s = inf"),
    "seconds": (lambda head, a, *rest: [head, "0.0" + a[1:], *rest], "line 2: stamp_ns = '0.0' is not a whole number"),
    "semicolons": (lambda *lines: [line.replace(",", ";") for line in lines], "missing columns stamp_ns, wx_rad_s"),
    "no names": (lambda head, *rest: list(rest), "missing columns stamp_ns, wx_rad_s"),
    "a column less": (
        lambda *lines: [re.sub(",[^,]*", "", line, count=1) for line in lines],
        "missing columns wx_rad_s, which readings of",
    ),
}


@pytest.mark.parametrize("format", ["euroc", "kalibr", "mcap", "rosbag2"])
@pytest.mark.parametrize("bad", BAD_READINGS)
def test_bad_readings_of_an_imu_are_neither_exported_nor_left_out(plain, tmp_path, bad, format):
    change, told = BAD_READINGS[bad]
    path = hand_made(shutil.copytree(plain, tmp_path / "bad")) / "imu.csv"
    path.write_text("\n".join(change(*path.read_text().splitlines())) + "\n")
    if format == "kalibr" and "column" not in told:
        exported(path.parent, format, tmp_path)  # it holds no readings
        return
    with pytest.raises(UserError, match=told) as error:
        exported(path.parent, format, tmp_path)
    assert "imu.csv" in str(error.value)
    assert not (tmp_path / format).exists()


def test_an_imu_without_readings_has_no_biases_to_export(plain, tmp_path):
    path = hand_made(shutil.copytree(plain, tmp_path / "bad")) / "imu-bmi088.csv"
    path.write_text(path.read_text().splitlines()[0] + "\n")
    with pytest.raises(UserError, match=r"imu-bmi088.csv: has no readings; remove the file"):
        exported(path.parent, "euroc", tmp_path)


@pytest.mark.parametrize("change", [lambda head: head.replace(",", ";"), lambda head: "0" + ",1" * head.count(",")])
@pytest.mark.parametrize("name", ["baro", "gnss", "range-finder"])
def test_readings_whose_columns_have_no_names_are_not_left_out(tmp_path_factory, tmp_path, name, change):
    sequence = tmp_path_factory.getbasetemp() / "all-sensors"
    if not sequence.exists():
        text = PLAIN.replace('{ kind = "baro" },', '{ kind = "baro" }, { kind = "gnss" }, { kind = "range-finder" },')
        shutil.copytree(rendered(tmp_path_factory.mktemp("sensors"), text), sequence)
    path = hand_made(shutil.copytree(sequence, tmp_path / "bad")) / f"{name}.csv"
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([change(head), *rows]) + "\n")
    with pytest.raises(UserError, match=rf"{name}.csv: missing columns stamp_ns, .* readings of kind = '{name}'"):
        exported(path.parent, "mcap", tmp_path)
    assert not (tmp_path / "mcap").exists()
