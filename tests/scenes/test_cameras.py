"""Several cameras on one vehicle, and their clock: files, poses, exports, and what is refused."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from tests.scenes.test_bag_exports import read
from tests.trajectories.scene import BOX, standing
from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_suite
from uavbench.bench.disk_space.sequence_bytes import sequence_bytes
from uavbench.bench.runner.extent import extents
from uavbench.bench.runner.tasks import Render
from uavbench.reports.evaluation.evaluate import evaluate_files
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.body import body_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import compare, verify, write_manifest
from uavbench.scenes.exports.euroc import yaml_number
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import BodyCamera, CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.tracker.images.image_times import doubts_of_times
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import Array, Pose, rotation_log
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.lidar import Lidar2d
from uavbench.trajectories.simulation.flight import FlightSpec

CAMERA = CameraSpec(width=128, height=96, horizontal_fov_deg=75.0)
PITCH_DEG, BASELINE_M = -25.0, 0.12
EXACT_IMU = Imu(
    rate_hz=1000.0, offset_m=(0.01, 0.02, -0.03), gyro_noise_rad_s_sqrt_hz=0.0, gyro_walk_rad_s2_sqrt_hz=0.0
)
ONE = SequenceSpec(
    name="one",
    seed=4,
    structure=Box(),
    environment=Indoor(),
    flight=FlightSpec(path=HandPilot(duration_s=0.35)),
    mount=Mount(pitch_deg=PITCH_DEG, offset_m=(0.03, 0.06, 0.0)),
    camera=CAMERA,
    rate_hz=20.0,
    sensors=(EXACT_IMU,),
    annotations=("depth",),
)
RIGHT = BodyCamera(
    name="right", mount=Mount(pitch_deg=PITCH_DEG, offset_m=(0.03, 0.06 - BASELINE_M, 0.0)), camera=CAMERA
)
LATE = BodyCamera(
    name="late",
    mount=Mount(pitch_deg=-40.0, yaw_deg=10.0, offset_m=(0.0, 0.0, 0.02)),
    camera=CameraSpec(width=80, height=64, distortion_model="radtan", distortion=(-0.1, 0.01, 0.001, 0.0)),
    offset_s=0.01,
)
SHIFT_S = 0.05


def made(spec: SequenceSpec, folder: Path) -> Sequence:
    generate(spec, folder, content_hash="abc")
    return Sequence.load(folder)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return made(ONE, tmp_path_factory.mktemp("one") / "one")


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return made(replace(ONE, cameras=(RIGHT, LATE)), tmp_path_factory.mktemp("three") / "three")


@pytest.fixture(scope="module")
def shifted(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    spec = replace(ONE, cameras=(RIGHT,), clock=CameraClock(timeshift_cam_imu_s=SHIFT_S))
    return made(spec, tmp_path_factory.mktemp("shifted") / "shifted")


def columns(path: Path) -> dict[str, Array]:
    with path.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def test_the_files_of_the_main_camera_are_those_of_a_vehicle_that_has_no_other(one: Sequence, three: Sequence) -> None:
    differing = {"sequence.json", "manifest.json"}
    names = {p.relative_to(one.folder).as_posix() for p in one.folder.rglob("*") if p.is_file()}
    assert {"frames/000006.png", "groundtruth.csv", "depth/000000.png", "imu.csv"} <= names
    for name in names - differing:
        assert (one.folder / name).read_bytes() == (three.folder / name).read_bytes(), name
    more = {p.relative_to(three.folder).as_posix() for p in three.folder.rglob("*") if p.is_file()} - names
    assert more and all(name.startswith(("cameras/right/", "cameras/late/")) for name in more)
    assert set(three.cameras) == {"right", "late"} and not one.cameras
    assert verify(three.folder).ok


def test_cameras_expose_at_once_or_as_late_as_they_say(three: Sequence) -> None:
    right, late = three.cameras["right"], three.cameras["late"]
    assert right.stamps_ns.tolist() == three.stamps_ns.tolist() == [k * 50_000_000 for k in range(len(three))]
    assert late.stamps_ns.tolist() == [k * 50_000_000 + 10_000_000 for k in range(len(late))]
    np.testing.assert_array_equal(right.ground_truth_table, three.ground_truth_table)
    flight = columns(three.folder / "flight.csv")
    rows = np.searchsorted(flight["stamp_ns"], late.stamps_ns)
    for k, name in enumerate(("px_m", "py_m", "pz_m", "qw", "qx", "qy", "qz", "vx_m_s"), start=2):
        np.testing.assert_array_equal(late.ground_truth_table[:, k], flight[name][rows])
    assert (late.camera.width, late.camera.distortion_model) == (80, "radtan")
    assert late.image(0).shape == (64, 80, 3) and right.image(0).shape == (96, 128, 3)


def test_the_images_of_stereo_are_of_one_world(three: Sequence) -> None:
    """The point of each pixel, by the depth of the left image, lies where the right image has it."""
    right = three.cameras["right"]
    agreeing = []
    for frame in range(len(three)):
        depth, other = three[frame].depth_m, right[frame].depth_m
        assert depth is not None and other is not None
        row, column = np.nonzero(depth)
        points = three.camera.rays(np.column_stack([column, row]).astype(float)) * depth[row, column, None]
        right_from_left = right.true_cam_from_world(frame) @ three.true_cam_from_world(frame).inverse()
        moved = right_from_left.transform(points)
        place = right.camera.project(moved)
        u, v = np.rint(place).astype(int).T
        near = (np.abs(place - np.rint(place)).max(axis=1) < 0.1) & (u >= 0) & (u < 128) & (v >= 0) & (v < 96)
        agreeing += (np.abs(other[v[near], u[near]] - moved[near, 2]) < 0.006).tolist()
        assert not np.array_equal(three.image(frame), right.image(frame))
    assert len(agreeing) > 1000 and np.mean(agreeing) > 0.93  # the rest is hidden in one of the two


def skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def chain_of(sequence: Sequence, folder: Path) -> dict[str, Any]:
    export(sequence, "kalibr", folder)
    return dict(yaml.safe_load((folder / "camchain-imucam.yaml").read_text()))


def test_the_epipolar_error_of_stereo_by_the_exported_calibration(three: Sequence, tmp_path: Path) -> None:
    chain = chain_of(three, tmp_path / "out")
    K = [np.array([[f, 0, u], [0, g, v], [0, 0, 1]]) for f, g, u, v in (chain[f"cam{k}"]["intrinsics"] for k in (0, 1))]
    T = np.array(chain["cam1"]["T_cn_cnm1"])
    assert pytest.approx(np.array([[1, 0, 0, -BASELINE_M], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), abs=1e-12) == T
    F = np.linalg.inv(K[1]).T @ skew(T[:3, 3]) @ T[:3, :3] @ np.linalg.inv(K[0])
    worst = 0.0
    for frame in range(len(three)):
        left, right = (
            camera.camera.project(camera.true_cam_from_world(frame).transform(three.structure.vertices))
            for camera in (three, three.cameras["right"])
        )
        one, two = (np.column_stack([pixels, np.ones(len(pixels))]) for pixels in (left, right))
        lines = one @ F.T
        error = np.abs(np.einsum("ij,ij->i", two, lines)) / np.linalg.norm(lines[:, :2], axis=1)
        worst = max(worst, float(error.max()))
        assert (left[:, 0] - right[:, 0]).min() > 5.0
    assert worst < 1e-6  # asked for: 0.01 px


def test_kalibrs_files_say_where_and_when_by_their_definitions(shifted: Sequence, tmp_path: Path) -> None:
    chain = chain_of(shifted, tmp_path / "out")
    assert list(chain) == ["cam0", "cam1"] and "T_cn_cnm1" not in chain["cam0"]
    for name, camera in (("cam0", shifted), ("cam1", shifted.cameras["right"])):
        body_from_imu = Pose(np.eye(3), np.array(EXACT_IMU.offset_m))
        expected = (camera.cam_from_body @ body_from_imu).matrix
        assert np.array(chain[name]["T_cam_imu"]) == pytest.approx(expected, abs=1e-15)
        assert chain[name]["resolution"] == [128, 96]
        assert chain[name]["timeshift_cam_imu"] == SHIFT_S
    imu = yaml.safe_load((tmp_path / "out" / "imu0.yaml").read_text())
    assert (imu["update_rate"], imu["accelerometer_noise_density"]) == (1000.0, 2e-3)
    assert imu["rostopic"] == "/imu/data_raw"
    # t_imu = t_cam + shift: the rates that the gyroscope reads then are those of the body in the image.
    readings = columns(shifted.folder / "imu.csv")
    table, stamps = shifted.ground_truth_table, shifted.stamps_ns
    t_imu = stamps / 1e9 + chain["cam0"]["timeshift_cam_imu"]
    for k, axis in enumerate("xyz"):
        gyro = readings[f"w{axis}_rad_s"] - readings[f"gyro_bias_{axis}_rad_s"]
        assert table[:, 12 + k] == pytest.approx(np.interp(t_imu, readings["stamp_ns"] / 1e9, gyro), abs=1e-9)
    assert np.abs(table[:, 12:15]).max() > 0.01


def test_small_numbers_in_yaml_are_read_back_as_numbers() -> None:
    for value in (1e-05, -2e-17, 1.5e-7, 1e22, 0.0, 0.25):
        assert yaml.safe_load(f"a: [{yaml_number(value)}]")["a"] == [value]


def test_a_shifted_clock_stamps_the_same_images_otherwise(one: Sequence, shifted: Sequence, tmp_path: Path) -> None:
    assert shifted.timeshift_cam_imu_ns == 50_000_000 and one.timeshift_cam_imu_ns == 0
    assert shifted.stamps_ns.tolist() == (one.stamps_ns[1:] - 50_000_000).tolist()
    np.testing.assert_array_equal(shifted.ground_truth_table[:, 2:], one.ground_truth_table[1:, 2:])
    for frame in range(len(shifted)):
        assert shifted.image_bytes(frame) == one.image_bytes(frame + 1)
    assert (shifted.folder / "imu.csv").read_bytes() == (one.folder / "imu.csv").read_bytes()
    early = made(replace(ONE, annotations=(), clock=CameraClock(timeshift_cam_imu_s=-0.013)), tmp_path / "early")
    assert early.stamps_ns.tolist() == (one.stamps_ns + 13_000_000).tolist()
    assert early.image_bytes(0) == one.image_bytes(0)


def test_jitter_is_of_the_exposure_and_the_stamps_tell_it(tmp_path: Path) -> None:
    spec = replace(ONE, annotations=(), sensors=(), cameras=(RIGHT,), clock=CameraClock(jitter_ms=2.0))
    jittered = made(spec, tmp_path / "jittered")
    late = jittered.stamps_ns - np.arange(len(jittered)) * 50_000_000
    assert 0.2e6 < np.abs(late).max() < 20e6 and (np.diff(jittered.stamps_ns) > 0).all()
    assert jittered.cameras["right"].stamps_ns.tolist() == jittered.stamps_ns.tolist()
    flight = columns(jittered.folder / "flight.csv")
    linear = np.interp(jittered.stamps_ns, flight["stamp_ns"], flight["px_m"])
    assert jittered.ground_truth_table[:, 2] == pytest.approx(linear, abs=1e-4)


def test_euroc_has_a_folder_for_each_camera_and_the_truth_by_the_imus_clock(shifted: Sequence, tmp_path: Path) -> None:
    export(shifted, "euroc", tmp_path / "out")
    mav, right = tmp_path / "out" / "mav0", shifted.cameras["right"]
    said = yaml.safe_load((mav / "cam1" / "sensor.yaml").read_text())
    assert np.array(said["T_BS"]["data"]).reshape(4, 4) == pytest.approx(
        right.cam_from_body.inverse().matrix, abs=1e-15
    )
    for frame, stamp in enumerate(right.stamps_ns.tolist()):
        assert (mav / "cam1" / "data" / f"{stamp}.png").read_bytes() == right.image_bytes(frame)
    rows = [line.split(",") for line in (mav / "state_groundtruth_estimate0" / "data.csv").read_text().splitlines()[1:]]
    truth = {int(row[0]): np.array(row[1:4], dtype=float) for row in rows}
    for stamp, place in zip(shifted.stamps_ns.tolist(), shifted.ground_truth_table[:, 2:5], strict=True):
        assert truth[stamp + 50_000_000] == pytest.approx(place, abs=1e-9)
    assert "t_imu = t_cam + 0.05 s" in (tmp_path / "out" / "README.md").read_text()


def test_a_bag_has_topics_and_a_frame_for_each_camera(three: Sequence, tmp_path: Path) -> None:
    export(three, "mcap", tmp_path / "out")
    messages = read(tmp_path / "out")
    for name in ("right", "late"):
        camera = three.cameras[name]
        images = messages[f"/{name}/image_raw"]
        assert [time for time, _ in images] == camera.stamps_ns.tolist()
        assert images[0][1].header.frame_id == f"{name}_optical_frame"
        assert bytes(images[0][1].data) == camera.image(0).tobytes()
        info = messages[f"/{name}/camera_info"][0][1]
        assert (info.width, info.k[0]) == (camera.camera.width, camera.camera.fx)
    ((_, still),) = messages["/tf_static"]
    places = {each.child_frame_id: each.transform for each in still.transforms}
    t = places["right_optical_frame"].translation
    assert [t.x, t.y, t.z] == pytest.approx([0.03, 0.06 - BASELINE_M, 0.0])
    assert set(places) == {"camera_optical_frame", "right_optical_frame", "late_optical_frame", "imu_link"}
    assert messages["/camera/image_raw"][0][1].header.frame_id == "camera_optical_frame"


def test_colmap_has_a_camera_and_images_of_each_and_a_rig_of_those_that_expose_at_once(
    three: Sequence, shifted: Sequence, tmp_path: Path
) -> None:
    export(three, "colmap", tmp_path / "three")
    model = tmp_path / "three" / "sparse" / "0"
    lines = [line.split() for line in (model / "cameras.txt").read_text().splitlines()[1:]]
    assert [line[:4] for line in lines] == [
        ["1", "PINHOLE", "128", "96"], ["2", "PINHOLE", "128", "96"], ["3", "OPENCV", "80", "64"],
    ]  # fmt: skip
    images = [line.split() for line in (model / "images.txt").read_text().splitlines()[2::2]]
    assert [row[9] for row in images if row[8] == "3"] == [
        f"late/{k:06d}.png" for k in range(len(three.cameras["late"]))
    ]
    row = next(row for row in images if row[9] == "right/000002.png")
    pose = three.cameras["right"].true_cam_from_world(2)
    assert [float(x) for x in row[1:8]] == pytest.approx([*pose.quaternion_wxyz, *pose.translation], abs=1e-12)
    assert (tmp_path / "three" / "images" / "right" / "000002.png").read_bytes() == three.cameras["right"].image_bytes(
        2
    )
    assert not (tmp_path / "three" / "rig_config.json").exists()
    assert not (tmp_path / "three" / "masks").exists(), "the sequence has none"
    assert "no rig_config.json" in (tmp_path / "three" / "README.md").read_text()
    export(shifted, "colmap", tmp_path / "stereo")
    ((rig,),) = ([each["cameras"] for each in json.loads((tmp_path / "stereo" / "rig_config.json").read_text())],)
    assert rig[0] == {"image_prefix": "camera/", "ref_sensor": True}
    assert rig[1]["cam_from_rig_translation"] == pytest.approx([-BASELINE_M, 0, 0], abs=1e-12)
    assert rotation_log(Pose.from_quaternion(rig[1]["cam_from_rig_rotation"], [0, 0, 0]).rotation) == pytest.approx(
        np.zeros(3), abs=1e-9
    )


@pytest.mark.parametrize("format", ["colmap", "transforms", "bop", "euroc", "tum"])
def test_times_of_an_export_are_found_from_the_images_of_each_camera(
    three: Sequence, tmp_path: Path, format: str
) -> None:
    """As they are for a user who tracks them: of COLMAP they stand beside the folder of the cameras' folders."""
    out = tmp_path / format
    export(three, format, out)
    folders = {path.parent for path in out.rglob("*.png") if path.parent.name not in ("depth", "mask", "mask_visib")}
    folders = {folder for folder in folders if not {"depths", "depth0"} & set(folder.parts)}
    assert len(folders) == (3 if format in ("colmap", "euroc") else 1)
    for folder in folders:
        assert doubts_of_times(folder, 20.0) == []
        (doubt,) = doubts_of_times(folder, 10.0)
        assert "seems to hold the times of the images" in doubt
    if format == "colmap":
        lines = (out / "timestamps.csv").read_text().splitlines()
        (out / "timestamps.csv").write_text("\n".join(line for line in lines if "right/000002" not in line))
        assert [folder.name for folder in folders if doubts_of_times(folder, 20.0)] == ["right"]


@pytest.mark.parametrize("format", sorted(set(EXPORTS) - {"euroc", "kalibr", "mcap", "rosbag2", "colmap"}))
def test_a_form_of_one_camera_says_so_and_exports_another_one_if_asked(
    three: Sequence, tmp_path: Path, format: str
) -> None:
    lines = export(three, format, tmp_path / "main")
    assert [line for line in lines if "`--camera right`" in line] and [
        line for line in lines if "`--camera late`" in line
    ]
    command = ["export", str(three.folder), "--format", format, "--out", str(tmp_path / "right"), "--camera", "right"]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert "--camera" not in done.output
    wrong = CliRunner().invoke(main, [*command[:-1], "rigth"])
    assert isinstance(wrong.exception, UserError) or "did you mean 'right'" in wrong.output


SUITE = """
title = "t"
rates_hz = [5.0]
[sequences.box]
rate_hz = {rate}
structure = {{ kind = "box" }}
environment = {{ kind = "indoor" }}
flight.path = {{ kind = "hand-pilot" }}
{lines}
[trackers]
hold = {{ kind = "hold" }}
"""


@pytest.mark.parametrize(
    ("lines", "rate", "told"),
    [
        ('cameras = [{ name = "right" }, { name = "left" }, { name = "right" }]', 15.0,
         r"sequences.box: cameras\[2\].name 'right': cameras\[0\] has this name already"),
        ('cameras = [{ name = "camera" }]', 15.0, r"cameras\[0\].name 'camera': the main camera has this name already"),
        ('cameras = [{ name = "../up" }]', 15.0, r"cameras\[0\].name '../up': use lower-case letters"),
        ('cameras = [{ mount = { pitch_deg = 3.0 } }]', 15.0, r"sequences.box.cameras\[0\].name: this key is missing"),
        ('cameras = [{ name = "a", offset_s = -0.1 }]', 15.0, r"cameras\[0\].offset_s: .*greater than or equal to 0"),
        ("clock = { shift_s = 0.1 }", 15.0, r"sequences.box.clock.shift_s: unknown key"),
        ("clock = { even = true }", 15.0, r"sequences.box.clock.even: frames are always evenly spaced; delete this"),
        ("clock = { jitter_ms = 1.0 }", 600.0, r"sequences.box.rate_hz: .*less than or equal to 500"),
        ('sensors = [{ kind = "lidar-2d", rate_hz = 1000.0 }]', 15.0, r"sensors\[0\].rate_hz: .*or equal to 500"),
    ],
)  # fmt: skip
def test_mistakes_in_the_tables_are_named(tmp_path: Path, lines: str, rate: float, told: str) -> None:
    (tmp_path / "s.toml").write_text(SUITE.format(lines=lines, rate=rate))
    with pytest.raises(UserError, match=told):
        load_suite(tmp_path / "s.toml")


def test_a_camera_in_the_structure_and_a_shift_beyond_the_flight_are_named(tmp_path: Path) -> None:
    inside = replace(ONE, cameras=(replace(RIGHT, mount=Mount(offset_m=(0.0, 0.0, -1.5))),))
    with pytest.raises(UserError, match=r"sequence one: camera right: .* the camera is inside the floor"):
        generate(inside, tmp_path / "inside", content_hash="")
    late = replace(ONE, clock=CameraClock(timeshift_cam_imu_s=5.0))
    with pytest.raises(UserError, match=r"sequence one: camera: no frame is exposed in the 0.35 s of the flight"):
        generate(late, tmp_path / "late", content_hash="")
    assert list(tmp_path.iterdir()) == []


def test_a_lens_that_cannot_be_rendered_is_named_with_its_camera_before_any_frame(tmp_path: Path) -> None:
    fisheye = replace(CAMERA, horizontal_fov_deg=100.0, distortion_model="equidistant", distortion=(0.0, 0.0, 0.0, 0.0))
    frames: list[int] = []
    with pytest.raises(UserError, match=r"^sequence one: right: with this distortion some pixels are too far off-axis"):
        generate(
            replace(ONE, cameras=(replace(RIGHT, camera=fisheye),)),
            tmp_path / "off",
            content_hash="",
            on_frame=lambda done, _: frames.append(done),
        )
    with pytest.raises(UserError, match=r"^sequence one: camera: with this distortion some pixels"):
        generate(replace(ONE, camera=fisheye), tmp_path / "off", content_hash="")
    assert frames == []
    assert list(tmp_path.iterdir()) == []


def test_images_of_a_further_camera_are_compared_by_tolerance_and_the_rest_by_bytes(
    three: Sequence, tmp_path: Path
) -> None:
    other = made(replace(ONE, cameras=(RIGHT, LATE)), tmp_path / "other")
    image = other.folder / "cameras" / "right" / "frames" / "000000.png"
    cv2.imwrite(str(image), np.clip(other.cameras["right"].image(0).astype(int) + 2, 0, 255).astype(np.uint8))
    (other.folder / "manifest.json").unlink()
    write_manifest(other.folder)
    verdict = compare(three.folder, other.folder)
    assert verdict.ok and verdict.method == "tolerance", verdict.problems


def test_the_dry_run_weighs_every_camera_and_a_lidars_rays(three: Sequence, shifted: Sequence, tmp_path: Path) -> None:
    def told(spec: SequenceSpec) -> float:
        (found,) = extents([Render(replace(spec, name="a-s0"), tmp_path / "a-s0")])
        return found.bytes

    one, right, late = (told(replace(ONE, cameras=cameras)) for cameras in ((), (RIGHT,), (LATE,)))
    assert told(replace(ONE, cameras=(RIGHT, LATE))) - one == pytest.approx((right - one) + (late - one), rel=1e-6)

    def of_frames(spec: SequenceSpec) -> float:  # both fill the contact sheet, which shows the main camera alone
        return sequence_bytes(spec, 40, 1.0) - sequence_bytes(spec, 20, 1.0)

    second = [of_frames(replace(ONE, cameras=(each,))) for each in (RIGHT, LATE)]
    alone = [of_frames(replace(ONE, mount=each.mount, camera=each.camera)) for each in (RIGHT, LATE)]
    assert second[0] - second[1] == pytest.approx(alone[0] - alone[1], rel=1e-6)
    assert right - one > 8 * 128 * 96
    delayed = replace(ONE, name="a-s0", clock=CameraClock(timeshift_cam_imu_s=SHIFT_S))
    assert extents([Render(delayed, tmp_path / "a-s0")])[0].frames == len(shifted)
    lidar = Lidar2d(rate_hz=20.0)
    table = lidar.measure(standing(0.35), BOX, np.random.default_rng(0))
    written = 8 * (2 + len(table.columns)) * len(table.stamps_ns)  # two stamps, and every column once
    assert (told(replace(ONE, sensors=(lidar,))) - told(replace(ONE, sensors=()))) == pytest.approx(written, rel=0.01)


@pytest.mark.parametrize("format", ["euroc", "kalibr", "mcap"])
def test_another_camera_alone_is_exported_with_the_sensors_of_the_body(
    shifted: Sequence, tmp_path: Path, format: str
) -> None:
    lines = export(shifted.cameras["right"], format, tmp_path / "right")
    whole = export(shifted, format, tmp_path / "whole")
    about = [line for line in whole if line.startswith(("Sensor", "Flight", "Mount", "Body"))]
    assert [line for line in lines if line.startswith(("Sensor", "Flight", "Mount", "Body"))] == about
    for name in ("mav0/imu0/data.csv", "mav0/imu0/sensor.yaml", "imu0.yaml"):
        assert (tmp_path / "right" / name).is_file() == (tmp_path / "whole" / name).is_file()
        if (tmp_path / "right" / name).is_file():
            assert (tmp_path / "right" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    if format == "euroc":
        truth = "mav0/state_groundtruth_estimate0/data.csv"
        rows = [(tmp_path / side / truth).read_text().splitlines() for side in ("right", "whole")]
        assert rows[0] == rows[1]
    if format == "mcap":
        alone, both = read(tmp_path / "right"), read(tmp_path / "whole")
        assert [time for time, _ in alone["/odom"]] == [time for time, _ in both["/odom"]]
        assert len(alone["/imu/data_raw"]) == len(both["/imu/data_raw"])


@pytest.fixture(scope="module")
def poses_of(three: Sequence, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of exports to TUM of the main camera and of `right`, of bags of both, and of a bag alone."""
    folder = tmp_path_factory.mktemp("poses")
    for name, each in {"main": three, "right": three.cameras["right"]}.items():
        export(each, "tum", folder / name)
        export(each, "mcap", folder / f"bag-{name}")
    (folder / "moved.mcap").write_bytes((folder / "bag-main" / "bag.mcap").read_bytes())
    return folder


@pytest.mark.parametrize(
    ("estimate", "mount"),
    [
        ("main", ""),
        ("right", ""),
        ("right", "cameras/right"),
        ("bag-main/bag.mcap:/tf:world.camera_optical_frame", ""),
        ("bag-main/bag.mcap:/tf:world.right_optical_frame", ""),
        ("bag-right/bag.mcap:/tf:world.camera_optical_frame", ""),
        ("moved.mcap:/tf:world.right_optical_frame", ""),
    ],
)
def test_poses_of_each_camera_are_converted_by_its_own_mount(
    three: Sequence, poses_of: Path, estimate: str, mount: str
) -> None:
    found = evaluate_files(three.folder, poses_of / estimate, mount=three.folder / mount)
    assert found.ate["translation_m"].max < 1e-9 and found.ate["rotation_deg"].max < 1e-6


def test_poses_of_different_cameras_are_not_compared(three: Sequence, poses_of: Path) -> None:
    main, right, mcap = poses_of / "main", poses_of / "right", poses_of / "bag-main" / "bag.mcap"
    with pytest.raises(UserError, match=r"'camera', and .*groundtruth.txt those of 'right': poses of different"):
        evaluate_files(main, right)
    with pytest.raises(UserError, match=r"camera 'right', whose mount .*cameras/late does not have"):
        evaluate_files(three.folder, right, mount=three.folder / "cameras" / "late")
    with pytest.raises(UserError, match="poses of different cameras"):
        evaluate_files(f"{mcap}:/tf:world.camera_optical_frame", right)
    evaluate_files(main, right, ignore_frames=True)
    (poses_of / "own.tum").write_text((main / "groundtruth.txt").read_text())  # as of a program that names no camera
    evaluate_files(right, poses_of / "own.tum")
    assert json.loads((right / "export.json").read_text())["camera"] == "right"
    assert (right / "README.md").read_text().startswith("# one, camera `right` in the format tum")


def test_stamps_of_the_cameras_clock_against_those_of_the_body_are_doubted(
    one: Sequence, shifted: Sequence, tmp_path: Path
) -> None:
    export(shifted, "mcap", tmp_path / "bag")
    export(shifted, "tum", tmp_path / "tum")
    export(one, "mcap", tmp_path / "not-shifted")
    bag, tum = f"{tmp_path / 'bag' / 'bag.mcap'}:/odom", tmp_path / "tum"
    for reference, estimate, offset_s in (
        (shifted.folder, bag, -SHIFT_S),
        (bag, shifted.folder, SHIFT_S),
        (shifted.folder / "flight.csv", shifted.folder, SHIFT_S),
        (bag, tum, SHIFT_S),
    ):
        apart = evaluate_files(reference, estimate, mount=shifted.folder, max_difference_s=0.02)
        assert any(f"--t-offset {offset_s:g}, " in doubt for doubt in apart.record["doubts"])
        found = evaluate_files(reference, estimate, mount=shifted.folder, max_difference_s=1e-6, t_offset_s=offset_s)
        assert found.ate["translation_m"].max < 1e-9 and not any("clock" in each for each in found.record["doubts"])
    for reference, estimate in ((shifted.folder, tum), (one.folder, f"{tmp_path / 'not-shifted' / 'bag.mcap'}:/odom")):
        found = evaluate_files(reference, estimate, mount=shifted.folder)
        assert not any("clock" in doubt for doubt in found.record["doubts"])


def test_undistorted_images_of_every_camera_are_told(three: Sequence, tmp_path: Path) -> None:
    lines = export(three, "kalibr", tmp_path / "out", undistort=True)
    assert [line for line in lines if line.startswith("Lens")] == [
        "Lens: the images of `late` are undistorted (radtan [-0.1, 0.01, 0.001, 0.0]); pixels outside the lens's field "
        "of view are black, and sharpness and noise differ."
    ]


def test_the_body_of_another_camera_has_its_sensors(shifted: Sequence) -> None:
    assert [*body_of(shifted.cameras["right"]).sensors] == [*body_of(shifted).sensors]


OWN = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 319.5, "cy": 239.5}


def load_own(folder, **values):
    """A camera.toml of a user."""
    path = folder / "camera.toml"
    path.write_text("".join(f"{key} = {value!r}\n".replace("'", '"') for key, value in {**OWN, **values}.items()))
    return Camera.load(path)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"fx": 15.0, "fy": 15.0},
        {"distortion_model": "radtan", "distortion": [-0.28, 0.07, 0.0002, 0.00002]},
        {"distortion_model": "radtan", "distortion": [-0.31, 0.13, 0.001, -0.002, -0.02]},
        {"distortion_model": "radtan", "distortion": [0.4, 0.1, 0.0, 0.0]},
        {"distortion_model": "radtan", "distortion": [-0.26, 0.078, 0.0, 0.0, -0.011], "fx": 300.0, "fy": 300.0},
        {"distortion_model": "equidistant", "distortion": [0.01, 0.0, 0.0, 0.0], "fx": 105.0, "fy": 105.0},
        {"cx": -100.0, "cy": 900.0},
    ],
)
def test_cameras_of_users_are_read(tmp_path, values):
    camera = load_own(tmp_path, **values)
    assert {key: getattr(camera, key) for key in (*OWN, *values)} == {
        key: tuple(value) if key == "distortion" else value for key, value in {**OWN, **values}.items()
    }


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fx": 4.5, "fy": 4.5}, r"fx = 4\.5 px is too short for 640 px .* neither in mm"),
        ({"fy": 0.8}, r"fy = 0\.8 px is too short for 480 px"),
        ({"distortion_model": "equidistant", "distortion": [0.0] * 4, "fx": 90.0}, r"fx = 90 px is too short"),
        ({"distortion_model": "radtan", "distortion": [-1.5, 0.0, 0.0, 0.0]}, r"folds over before pixel \(0, 240\)"),
        ({"distortion_model": "radtan", "distortion": [-0.28, 0.07, 0.9, 0.0]}, r"the order is k1, k2, p1, p2, k3"),
    ],
)
def test_numbers_that_no_camera_of_these_images_has_are_told(tmp_path, values, message):
    with pytest.raises(UserError, match=rf"camera\.toml: .*{message}"):
        load_own(tmp_path, **values)
