"""A camera on a gimbal: its files, what trackers are told, what exports hold, and what is refused."""

import csv
import json
import re
import shutil
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.hand_made import hand_made
from tests.scenes.test_bag_exports import read
from uavbench.bench.challenge.pack import _rendered
from uavbench.bench.config.suite import load_suite, recorded_spec
from uavbench.bench.external.job_folder import write_sensors
from uavbench.bench.runner.extent import shortfalls
from uavbench.bench.twin.twin import spec_of
from uavbench.reports.evaluation.find_trajectory import mount_of
from uavbench.reports.metrics.frame_errors import frame_errors
from uavbench.reports.scoring.score import score
from uavbench.scenes.dataset.body import body_of, samples_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.effects.exposure import RollingShutter
from uavbench.scenes.exports.registry import EXPORTS, export
from uavbench.scenes.generate import generate
from uavbench.scenes.shots.shots import rehearse
from uavbench.scenes.spec import BodyCamera, CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results, evaluated_poses
from uavbench.tracker.run import make_record
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.gimbal.axes import PitchAxis
from uavbench.trajectories.gimbal.encoder import Encoder
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.paths.around import FigureEight
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.simulation.flight import FlightSpec

CAMERA = CameraSpec(width=128, height=96, horizontal_fov_deg=75.0)
GIMBAL = Gimbal(pitch_deg=-15.0, offset_m=(0.03, 0.0, -0.02))
SPEC = SequenceSpec(
    name="one",
    seed=4,
    structure=Box(),
    environment=Indoor(),
    flight=FlightSpec(path=FigureEight(period_s=1.2, loops=1, width_m=0.3, depth_m=0.05, height_m=0.6)),
    mount=GIMBAL,
    camera=CAMERA,
    rate_hz=5.0,
    sensors=(Imu(),),
    annotations=("mask",),
    effects=(RollingShutter(readout_ms=20.0),),
    clock=CameraClock(timeshift_cam_imu_s=0.013),
    cameras=(
        BodyCamera(name="fixed", mount=Mount(pitch_deg=-15.0), camera=CAMERA),
        BodyCamera(name="aimed", mount=Gimbal(axes="roll-pitch", mode="target"), camera=CAMERA),
    ),
)


def made(spec: SequenceSpec, folder: Path) -> Sequence:
    generate(spec, folder, content_hash="abc")
    return Sequence.load(folder)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return made(SPEC, tmp_path_factory.mktemp("one") / "one")


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def rotations(rows: dict[str, np.ndarray]) -> Rotation:
    return Rotation.from_quat(np.column_stack([rows[name] for name in ("qx", "qy", "qz", "qw")]))


def angles_of(cam_from_body: Rotation) -> np.ndarray:
    """Yaw, roll and pitch upwards (n, 3) of a camera on the body, by SciPy."""
    cam_from_forward = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    yaw, roll, down = (cam_from_body.inv() * cam_from_forward).as_euler("ZXY").T
    return np.column_stack([yaw, roll, -down])


def test_the_pose_at_each_frame_is_that_of_the_true_angles_of_the_joints(one):
    mounts = table(one.folder / "mounts.csv")
    assert mounts["stamp_ns"].tolist() == one.stamps_ns.tolist()
    angles = np.column_stack([mounts[f"{joint}_rad"] for joint in ("yaw", "roll", "pitch")])
    np.testing.assert_allclose(angles_of(rotations(mounts)), angles, atol=1e-12)
    assert np.degrees(np.ptp(angles[:, 1])) > 3, "the flight tilts the body"
    offsets = -rotations(mounts).inv().apply(np.column_stack([mounts[f"p{axis}_m"] for axis in "xyz"]))
    np.testing.assert_allclose(offsets, np.tile(GIMBAL.offset_m, (len(offsets), 1)), atol=1e-12)
    for frame in range(len(one)):
        expected = one.cam_from_body_at(frame) @ one.ground_truth.pose(frame).inverse()
        assert one.true_cam_from_world(frame).matrix.tolist() == expected.matrix.tolist()


def test_the_horizon_stays_level_while_the_vehicle_tilts(one):
    def roll_deg(sequence: Sequence) -> float:
        return max(abs(np.degrees(np.arcsin(frame.cam_from_world.rotation[0, 2]))) for frame in sequence)

    assert roll_deg(one.cameras["fixed"]) > 5 * roll_deg(one) > 0


@pytest.mark.parametrize("name", ["camera", "aimed"])
def test_images_are_taken_from_the_true_pose(one, name):
    sequence = one if name == "camera" else one.cameras[name]
    K = sequence.camera.K
    for frame in sequence:
        corners = frame.cam_from_world.transform(sequence.structure.vertices)
        projected = (corners / corners[:, 2:]) @ K.T
        rows, columns = np.nonzero(frame.mask == 1)
        seen = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        outline = np.array([*projected[:, :2].min(axis=0), *projected[:, :2].max(axis=0)])
        # the mask is that of the middle row's pose; pixels count from their centres
        assert seen == pytest.approx(outline, abs=1.2)


def test_a_target_is_kept_within_the_lag_of_the_servos(one):
    """At its elevation, since these two axes cannot turn the camera's heading."""
    flight = table(one.folder / "flight.csv")
    fastest = max(np.linalg.norm([flight[f"w{axis}_rad_s"] for axis in "xyz"], axis=0))
    lag = 2 * 0.7 / (2 * np.pi * 10.0)
    for frame in one.cameras["aimed"]:
        cam_from_world = frame.cam_from_world
        x, y, z = one.structure.bounds.mean(axis=0) - cam_from_world.inverse().translation
        error = np.arcsin(cam_from_world.rotation[2, 2]) - np.arctan2(z, np.hypot(x, y))
        assert abs(error) < lag * fastest


def test_each_row_of_a_rolling_shutter_has_its_own_mount(one):
    mounts, bodies = (np.load(one.folder / f"row_{name}.npy") for name in ("mounts", "poses"))
    assert mounts.shape == bodies.shape == (len(one), CAMERA.height, 7)
    middle = (mounts[:, CAMERA.height // 2 - 1] + mounts[:, CAMERA.height // 2]) / 2
    expected = [[*pose.translation, *pose.quaternion_wxyz] for pose in map(one.cam_from_body_at, range(len(one)))]
    np.testing.assert_allclose(middle, expected, atol=1e-5)
    assert np.abs(np.diff(mounts[:, :, 3:], axis=1)).max() > 1e-6
    shifted = one.stamps_ns + one.timeshift_cam_imu_ns
    motion = GIMBAL.along(_flight(), np.zeros(3))
    late = round(one.info["row_delay_ns"] * (CAMERA.height - 1) / 2)
    top = [motion(int(stamp) - late) for stamp in shifted]
    np.testing.assert_allclose(mounts[:, 0, 3:], [pose.quaternion_wxyz for pose in top], atol=1e-9)


def _flight():
    from uavbench.scenes.scene import build_scene
    from uavbench.trajectories.simulation.flight import fly

    return fly(SPEC.flight, SPEC.mount.at_rest, build_scene(SPEC).obstacles, SPEC.seed)


def test_readings_are_the_true_angles_with_the_errors_of_the_config(one):
    read = table(one.folder / "gimbal.csv")
    joints = ["yaw", "roll", "pitch"]
    assert list(read) == ["stamp_ns", *(f"{j}_rad" for j in joints), *(f"true_{j}_rad" for j in joints)]
    for joint in joints:
        errors = np.degrees(read[f"{joint}_rad"] - read[f"true_{joint}_rad"])
        assert 0.03 < errors.std() < 0.1
        assert abs(errors.mean()) < 0.5
    mounts = table(one.folder / "mounts.csv")
    at = mounts["stamp_ns"] + one.timeshift_cam_imu_ns
    between = np.interp(at, read["stamp_ns"], read["true_pitch_rad"])
    np.testing.assert_allclose(between, mounts["pitch_rad"], atol=1e-3)
    assert list(table(one.folder / "gimbal-aimed.csv")) == [
        "stamp_ns", "roll_rad", "pitch_rad", "true_roll_rad", "true_pitch_rad",
    ]  # fmt: skip
    assert not (one.folder / "gimbal-fixed.csv").exists()


def test_a_gimbal_changes_no_byte_of_the_other_cameras_and_sensors(one, tmp_path):
    bare = made(replace(SPEC, mount=GIMBAL.at_rest, cameras=SPEC.cameras[:1]), tmp_path / "bare")
    for name in ("imu.csv", "flight.csv", "groundtruth.csv", "row_poses.npy"):
        before, now = ((folder / name).read_bytes() for folder in (bare.folder, one.folder))
        if name == "row_poses.npy":  # by way of the camera, whose rounding differs
            before, now = (np.load(folder / name).round(12).tolist() for folder in (bare.folder, one.folder))
        assert before == now, name
    for path in sorted((bare.folder / "cameras" / "fixed").rglob("*")):
        if path.is_file():
            assert path.read_bytes() == (one.folder / path.relative_to(bare.folder)).read_bytes(), path


def test_the_same_seed_gives_the_same_bytes_and_the_record_the_same_spec(one, tmp_path):
    again = made(SPEC, tmp_path / "again")
    for path in sorted(one.folder.rglob("*")):
        if path.is_file():
            assert path.read_bytes() == (again.folder / path.relative_to(one.folder)).read_bytes(), path
    assert recorded_spec(one.info["config"], one.folder / "sequence.json") == SPEC


def test_trackers_are_given_the_encoders_and_the_geometry_and_nothing_true(one, tmp_path):
    body = body_of(one)
    assert body.cam_from_body is None
    assert (body.gimbal.joints, body.gimbal.offset_m, body.gimbal.yaw_deg) == (GIMBAL.joints, GIMBAL.offset_m, 0.0)
    sensor = body.sensors["gimbal"]
    assert sensor.columns == ("yaw_rad", "roll_rad", "pitch_rad")
    assert sensor.parameters["noise_deg"] == 0.06
    samples = samples_of(one, "gimbal", sensor)
    near = [int(np.argmin(np.abs(samples.stamps_ns - stamp))) for stamp in one.stamps_ns + one.timeshift_cam_imu_ns]
    for frame, row in enumerate(near):
        error = body.gimbal.cam_from_body_at(samples.values[row]) @ one.cam_from_body_at(frame).inverse()
        assert np.degrees(np.linalg.norm(error.log()[3:])) < 1.5
    assert body.sensors["gimbal-aimed"].columns == ("roll_rad", "pitch_rad")
    aimed = body_of(one.cameras["aimed"])
    assert (aimed.cam_from_body, aimed.gimbal.joints) == (None, ("roll", "pitch"))
    assert body_of(one.cameras["fixed"]).gimbal is None
    write_sensors(tmp_path, body)
    written = (tmp_path / "sensors.toml").read_text()
    assert "true" not in written
    assert "cam_from_body" not in written
    about = tomllib.loads(written)["sensors"]["gimbal"]
    assert about["joints"] == ["yaw", "roll", "pitch"]
    assert (about["yaw_deg"], about["offset_m"]) == (0.0, [0.03, 0.0, -0.02])


def test_of_results_the_poses_of_the_camera_are_evaluated(one, tmp_path):
    off = Pose(np.eye(3), np.array([0.0, 0.0, 0.02]))
    poses = [off @ frame.cam_from_world for frame in one]
    rows = tuple(TrackResult(status="ok", cam_from_world=pose, stage_ms={"total": 1.0}) for pose in poses)
    record = make_record(Hold(), one, rate_hz=5.0, seed=0, errors=[])
    results = Results(record, np.arange(len(one)), one.stamps_ns, rows)
    errors = frame_errors(one, results)
    np.testing.assert_allclose(errors.translation_m, 0.02, atol=1e-9)
    assert errors.angle_deg.max() < 1e-5
    results.save(tmp_path / "results", evaluated_poses(one).select(results.frames))
    for name in ("estimate", "groundtruth"):
        assert (tmp_path / "results" / f"{name}_world_from_cam.tum").is_file()
    assert score(one, Results.load(tmp_path / "results")).to_json()["ate"]["none"]["translation_m"][
        "rmse"
    ] == pytest.approx(0.02)


@pytest.mark.parametrize("format", ["euroc", "kalibr"])
def test_formats_of_fixed_extrinsics_refuse_a_gimbal_by_name(one, tmp_path, format):
    with pytest.raises(UserError, match=f"camera 'camera' is on a gimbal, and the format {format} has one pose"):
        export(one, format, tmp_path / "out")
    fixed = replace(one.cameras["fixed"], vehicle=one.folder)
    export(fixed, format, tmp_path / "fixed")
    with pytest.raises(UserError, match=f"camera 'aimed' is on a gimbal, and the format {format} has one pose"):
        export(replace(one.cameras["aimed"], vehicle=one.folder), format, tmp_path / "aimed")
    assert not (tmp_path / "out").exists()


def test_a_target_that_is_seen_in_some_frames_or_in_none_is_told(tmp_path):
    sway = FlightSpec(path=FigureEight(period_s=1.2, loops=1, width_m=0.1, depth_m=0.05, height_m=0.6, rise_m=0.3))
    aimed = replace(SPEC, flight=sway, cameras=(), effects=(), annotations=(), clock=CameraClock())
    stops = PitchAxis(least_deg=-21.0)
    some = replace(aimed, mount=Gimbal(mode="target", target_m=(0.0, 0.0, 0.0), pitch_axis=stops))
    (told,) = rehearse(some)
    begin = r"gimbal of camera: the stops of pitch_axis, -21 to 60 degrees, keep it from its target in \d+ of"
    assert re.match(begin, told)
    assert made(some, tmp_path / "some").info["unreached"] == [told]
    (line,) = shortfalls([tmp_path / "some" / "sequence.json"])
    assert line == f"one: {told}"
    none = replace(aimed, mount=Gimbal(mode="target", target_m=(0.0, 0.0, -9.0), pitch_axis=stops))
    for way in (rehearse, lambda spec: made(spec, tmp_path / "none")):
        with pytest.raises(UserError, match=r"sequence one: camera camera: mount.target_m: the stops of pitch_axis"):
            way(none)


@pytest.mark.parametrize("format", ["mcap", "rosbag2"])
def test_bags_hold_the_moving_transform_and_the_encoders(one, tmp_path, format):
    export(one, format, tmp_path / "out")
    messages = read(tmp_path / "out")
    static = {t.child_frame_id for _, message in messages["/tf_static"] for t in message.transforms}
    assert "fixed_optical_frame" in static
    assert not {"camera_optical_frame", "aimed_optical_frame"} & static
    moving = [t for _, message in messages["/tf"] for t in message.transforms]
    shift = one.timeshift_cam_imu_ns
    for frame_id, camera in (("camera_optical_frame", one), ("aimed_optical_frame", one.cameras["aimed"])):
        of_camera = {stamp_of(t): t for t in moving if t.child_frame_id == frame_id}
        of_body = {stamp_of(t): t for t in moving if t.child_frame_id == "base_link"}
        assert sorted(of_camera) == (camera.stamps_ns + shift).tolist()
        for number, stamp in enumerate(sorted(of_camera)):
            assert of_camera[stamp].header.frame_id == "base_link"
            world_from_cam = matrix_of(of_body[stamp]) @ matrix_of(of_camera[stamp])
            expected = camera.true_cam_from_world(number).inverse().matrix
            np.testing.assert_allclose(world_from_cam, expected, atol=1e-9)
    read_rows = table(one.folder / "gimbal.csv")
    joints = [message for _, message in messages["/gimbal/joint_states"]]
    assert [stamp_of(m) for m in joints] == read_rows["stamp_ns"].astype(int).tolist()
    assert list(joints[0].name) == ["gimbal_yaw", "gimbal_roll", "gimbal_pitch"]
    positions = np.array([list(m.position) for m in joints])
    assert positions[:, 2].tolist() == read_rows["pitch_rad"].tolist()
    assert not [m for m in joints if len(m.velocity) or len(m.effort)]  # nothing measures them
    assert "/gimbal_aimed/joint_states" in messages


def stamp_of(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def matrix_of(transform) -> np.ndarray:
    q, p = transform.transform.rotation, transform.transform.translation
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    out[:3, 3] = [p.x, p.y, p.z]
    return out


def test_formats_of_camera_poses_hold_the_true_ones(one, tmp_path):
    export(one, "tum", tmp_path / "tum")
    rows = np.loadtxt(tmp_path / "tum" / "groundtruth.txt")
    for number, row in enumerate(rows):
        expected = one.true_cam_from_world(number).inverse()
        np.testing.assert_allclose(row[1:4], expected.translation, atol=1e-9)
        np.testing.assert_allclose(Rotation.from_quat(row[4:]).as_matrix(), expected.rotation, atol=1e-9)
    told = "Gimbal: the camera's pose on the body at each image (`mounts.csv`) is not included."
    assert told in not_held(tmp_path / "tum")
    export(one, "colmap", tmp_path / "colmap")
    assert not (tmp_path / "colmap" / "rig_config.json").exists()
    assert any("the rig is not rigid" in line for line in not_held(tmp_path / "colmap"))


def not_held(folder: Path) -> list[str]:
    return json.loads((folder / "export.json").read_text())["not_held"]


def test_every_format_either_exports_a_gimbal_or_refuses_it(one, tmp_path):
    for format, about in EXPORTS.items():
        if about.fixed_mounts:
            with pytest.raises(UserError, match="gimbal"):
                export(one, format, tmp_path / format)
        elif format not in ("mcap", "rosbag2", "tum", "colmap"):  # tested above
            assert any("gimbal" in line.lower() for line in export(one, format, tmp_path / format))


def test_what_needs_a_fixed_mount_refuses_a_gimbal_by_name(one, tmp_path):
    with pytest.raises(UserError, match=r"the camera is on a gimbal: mounts\.csv has its pose at each frame"):
        _ = one.cam_from_body
    with pytest.raises(UserError, match="no one mount converts its poses to those of the body"):
        mount_of(one.folder)
    with pytest.raises(UserError, match="poses of the body follow from those of a camera only with a fixed mount"):
        replace(SPEC, flight=FlightSpec(path=Recorded(frame="camera")))
    slow = replace(SPEC, cameras=(), mount=replace(GIMBAL, encoder=Encoder(rate_hz=0.2)))
    with pytest.raises(UserError, match=r"gimbal of camera: encoder\.rate_hz 0\.2: one reading takes 5 s"):
        generate(slow, tmp_path / "slow", content_hash="")
    assert not (tmp_path / "slow").exists()


@dataclass(frozen=True)
class gimbal(Imu):
    """A user's sensor whose file has the name of that of a gimbal."""


def test_a_sensor_of_the_same_name_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"sensors\[0\], gimbal: its name, .* is taken by another file"):
        generate(replace(SPEC, cameras=(), sensors=(gimbal(),)), tmp_path / "two", content_hash="")
    assert not (tmp_path / "two").exists()


def test_a_twin_and_a_challenge_refuse_a_gimbal_by_name(one, tmp_path):
    folder = hand_made(shutil.copytree(one.folder, tmp_path / "plain"))
    info = json.loads((folder / "sequence.json").read_text())
    info["config"]["clock"] = {"jitter_ms": 0.0, "timeshift_cam_imu_s": 0.0}
    (folder / "sequence.json").write_text(json.dumps(info))
    with pytest.raises(UserError, match="its camera is on a gimbal, which twins do not support"):
        spec_of(Sequence.load(folder))
    path = written(tmp_path, '{ kind = "gimbal" }')
    with pytest.raises(UserError, match="small: box-s0 has its camera on a gimbal"):
        _rendered(load_suite(path))


SUITE = """
title = "small"
rates_hz = [15.0]
[sequences.box]
structure = { kind = "box" }
environment = { kind = "indoor" }
flight.path = { kind = "hover", duration_s = 1.0 }
mount = MOUNT
cameras = [{ name = "right", mount = MOUNT, offset_s = 0.01 }]
[trackers]
hold = { kind = "hold" }
"""


def written(folder: Path, mount: str) -> Path:
    path = folder / "small.toml"
    path.write_text(SUITE.replace("MOUNT", mount))
    return path


def test_a_mount_without_a_kind_is_fixed(tmp_path):
    first, second = (
        load_suite(written(tmp_path, mount)).sequences[0]
        for mount in ("{ pitch_deg = -20.0 }", '{ kind = "fixed", pitch_deg = -20.0 }')
    )
    assert first == second
    assert first.mount == first.cameras[0].mount == Mount(pitch_deg=-20.0)


@pytest.mark.parametrize(
    ("mount", "told"),
    [
        ('{ kind = "gimball" }', r"mount\.kind: unknown kind 'gimball'; did you mean 'gimbal'\? \(valid: "),
        ("{ axes = 3 }", r"sequences\.box\.mount\.axes: unknown key"),
        ('{ kind = "gimbal", axes = "pitch-yaw" }', r"sequences\.box\.mount\.axes: "),
        ('{ kind = "gimbal", pitch_deg = 75.0 }', r"sequences\.box\.mount: pitch_deg 75 is beyond the stops"),
        ('{ kind = "gimbal", encoder = { rate_hz = 501.0 } }', r"mount\.encoder\.rate_hz: .*less than or equal to 500"),
        ('{ kind = "gimbal", pitch_axis = { damping = 0.0 } }', r"mount\.pitch_axis\.damping: .*greater than 0"),
        ('{ kind = "gimbal", encoder = { noise = 1.0 } }', r"encoder\.noise: unknown key; did you mean 'noise_deg'"),
        ("3", r"sequences\.box\.mount: "),
    ],
)  # fmt: skip
def test_mistakes_in_a_mount_are_named_by_their_key(tmp_path, mount, told):
    with pytest.raises(UserError, match=told):
        load_suite(written(tmp_path, mount))


def test_two_gimbals_of_one_name_are_refused(tmp_path):
    text = SUITE.replace("MOUNT", '{ kind = "gimbal" }').replace('"right"', '"camera"')
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(UserError, match=r"cameras\[0\].name 'camera': the main camera has this name already"):
        load_suite(tmp_path / "two.toml")


@pytest.mark.parametrize("bad", [{}, {"joints": ["tilt"]}, {"joints": ["pitch"], "offset_m": [0, 0]}, 3])
def test_a_record_of_a_gimbal_that_is_damaged_is_refused_by_name(one, bad):
    info = {**one.info, "sensors": {**one.info["sensors"], "gimbal.csv": bad}}
    with pytest.raises(UserError, match=r"sequence\.json: sensors"):
        body_of(replace(one, info=info))


def test_a_table_of_mounts_that_is_damaged_is_refused_by_name(one, tmp_path):
    folder = hand_made(shutil.copytree(one.folder, tmp_path / "bad"))
    lines = (folder / "mounts.csv").read_text().splitlines()
    for bad, told in (
        (lines[:-1], "its stamps differ from those of frames.csv"),
        ([*lines[:-1], ",".join([*lines[-1].split(",")[:5], "0", "0", "0", "0", "0", "0", "0"])], "not a pose"),
    ):
        (folder / "mounts.csv").write_text("\n".join(bad) + "\n")
        with pytest.raises(UserError, match=rf"mounts\.csv: .*{told}"):
            Sequence.load(folder).true_cam_from_world(0)
