"""Every number of every export, of a small sequence that is written by hand: no renderer."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.reports.drawn import CAM_FROM_BODY, make_sequence
from uavbench.bench.cli.files import EXPORTS as NAMED
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.ground_truth_files import GROUND_TRUTH_COLUMNS
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.bop import beyond
from uavbench.scenes.exports.registry import EXPORTS, camera_ground_truth, export
from uavbench.tracker.images.image_times import doubts_of_times
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array, Pose

FRAMES = 4
MOUNT = Pose.exp(np.array([0.05, -0.02, 0.1, 0.1, -0.2, 0.05])) @ CAM_FROM_BODY
"""A camera off the body's middle and turned against it, so that a pose is never its own inverse."""
LENS = Camera(320, 240, 230.0, 235.0, 161.0, 118.5, "radtan", (-0.1, 0.02, 0.001, -0.002))
PINHOLE = Camera(320, 240, 230.0, 235.0, 161.0, 118.5)
DEPTH_UNIT_M = 0.001
IMU = """stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2,gyro_bias_x_rad_s
0,0.1,0.2,0.3,1.0,2.0,9.5,7.0
5000000,0.11,0.21,0.31,1.1,2.1,9.6,7.1
"""


def rewrite(sequence: Sequence, **info: object) -> Sequence:
    """The sequence with other words in its `sequence.json`."""
    (sequence.folder / "sequence.json").write_text(json.dumps({**sequence.info, **info}))
    return Sequence.load(sequence.folder)


def drawn_depth(frame: int) -> Array:
    """Depths in m (240, 320): a ramp with a hole."""
    depth = 1.0 + 0.01 * frame + np.linspace(0, 2, 320) * np.ones((240, 1))
    depth[:20, :30] = 0.0
    return np.round(depth / DEPTH_UNIT_M) * DEPTH_UNIT_M


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """With distinct velocities, rates and accelerations, an IMU, and depth and mask of all frames."""
    made = make_sequence(tmp_path_factory.mktemp("exports") / "arc", FRAMES)
    (made.folder / "camera.toml").unlink()  # what is there is not overwritten
    LENS.save(made.folder / "camera.toml")
    table = made.ground_truth_table.copy()
    table[:, 9:] = np.random.default_rng(0).normal(size=(FRAMES, 9))
    rows = [",".join([str(int(r[0])), str(int(r[1])), *map(repr, r[2:].tolist())]) for r in table]
    (made.folder / "groundtruth.csv").write_text("\n".join([",".join(GROUND_TRUTH_COLUMNS), *rows]) + "\n")
    (made.folder / "imu.csv").write_text(IMU)
    for kind in ("depth", "mask"):
        (made.folder / kind).mkdir()
    for frame in range(FRAMES):
        units = np.rint(drawn_depth(frame) / DEPTH_UNIT_M).astype(np.uint16)
        cv2.imwrite(str(made.folder / "depth" / f"{frame:06d}.png"), units)
        mask = np.full((240, 320), 2, np.uint8)  # something else
        mask[100 + frame : 140, 150:180] = 1
        cv2.imwrite(str(made.folder / "mask" / f"{frame:06d}.png"), mask)
    return rewrite(made, cam_from_body=MOUNT.matrix.tolist(), depth_m_per_unit=DEPTH_UNIT_M)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Images and ground truth, and no more."""
    return make_sequence(tmp_path_factory.mktemp("exports") / "plain", 2)


@pytest.fixture(scope="module")
def exported(sequence: Sequence, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders by format."""
    base, folders = tmp_path_factory.mktemp("exported"), {}
    for name in EXPORTS:
        steps: list[tuple[int, int]] = []
        note = lambda done, total, steps=steps: steps.append((done, total))  # noqa: E731
        export(undistorted(sequence, name), name, base / name, note)  # type: ignore[arg-type]
        assert steps == [(k + 1, FRAMES) for k in range(FRAMES)], name
        folders[name] = base / name
    return folders


def undistorted(sequence: Sequence, name: str) -> Sequence:
    """The sequence with a pinhole for a format that has no place for its lens: its images are copied as they are."""
    held = EXPORTS[name].holds_lens(sequence.camera)
    return sequence if held else replace(sequence, camera=PINHOLE)


def source(sequence: Sequence, frame: int) -> bytes:
    return (sequence.folder / sequence.files[frame]).read_bytes()


def listed(path: Path, separator: str) -> list[list[str]]:
    """Cells of a file's lines, without its comments."""
    return [line.split(separator) for line in path.read_text().splitlines() if not line.startswith("#")]


def yaml_of(path: Path) -> dict[str, str]:
    """The values of a flat file, and those of the block of T_BS."""
    lines = (line.partition("#")[0].strip() for line in path.read_text().splitlines())
    return dict(line.split(": ", 1) for line in lines if ": " in line)


def T_BS(path: Path) -> Array:
    said = yaml_of(path)
    assert (said["cols"], said["rows"]) == ("4", "4")
    return np.array(json.loads(said["data"])).reshape(4, 4)


# EuRoC


def test_euroc_t_bs_takes_points_of_the_camera_to_the_body(sequence: Sequence, exported: dict[str, Path]) -> None:
    mav = exported["euroc"] / "mav0"
    cam = T_BS(mav / "cam0" / "sensor.yaml")
    point_cam = np.array([0.3, -0.2, 2.0, 1.0])
    np.testing.assert_allclose(MOUNT.transform((cam @ point_cam)[None, :3])[0], point_cam[:3], atol=1e-9)
    for sensor in ("imu0", "state_groundtruth_estimate0"):
        np.testing.assert_array_equal(T_BS(mav / sensor / "sensor.yaml"), np.eye(4))


def test_euroc_truth_is_the_body_and_its_velocity(sequence: Sequence, exported: dict[str, Path]) -> None:
    rows = np.array(listed(exported["euroc"] / "mav0" / "state_groundtruth_estimate0" / "data.csv", ","), dtype=float)
    names = [GROUND_TRUTH_COLUMNS.index(name) for name in ("vx_m_s", "vy_m_s", "vz_m_s")]
    np.testing.assert_array_equal(rows[:, 0], sequence.stamps_ns)
    np.testing.assert_allclose(rows[:, 1:4], sequence.ground_truth.positions_m)
    np.testing.assert_allclose(rows[:, 4:8], sequence.ground_truth.quaternions_wxyz)
    np.testing.assert_array_equal(rows[:, 8:11], sequence.ground_truth_table[:, names])
    np.testing.assert_array_equal(rows[:, 11:17], 0.0)
    assert rows.shape[1] == 17


def test_euroc_images_and_camera(sequence: Sequence, exported: dict[str, Path]) -> None:
    cam = exported["euroc"] / "mav0" / "cam0"
    stamps = sequence.stamps_ns.tolist()
    assert listed(cam / "data.csv", ",") == [[str(stamp), f"{stamp}.png"] for stamp in stamps]
    assert len(list((cam / "data").iterdir())) == FRAMES
    for frame, stamp in enumerate(stamps):
        assert (cam / "data" / f"{stamp}.png").read_bytes() == source(sequence, frame)
    said = yaml_of(cam / "sensor.yaml")
    assert float(said["rate_hz"]) == 15
    assert json.loads(said["resolution"]) == [320, 240]
    assert json.loads(said["intrinsics"]) == [230.0, 235.0, 161.0, 118.5]
    assert json.loads(said["distortion_coefficients"]) == [-0.1, 0.02, 0.001, -0.002]
    assert (said["camera_model"], said["distortion_model"]) == ("pinhole", "radial-tangential")


@pytest.mark.parametrize(
    ("camera", "model", "coefficients"),
    [
        (PINHOLE, "radial-tangential", [0, 0, 0, 0]),
        (
            replace(LENS, distortion_model="equidistant", distortion=(0.1, 0.2, 0.3, 0.4)),
            "equidistant",
            [0.1, 0.2, 0.3, 0.4],
        ),
    ],
)
def test_euroc_names_of_lenses(
    sequence: Sequence, tmp_path: Path, camera: Camera, model: str, coefficients: list[float]
) -> None:
    export(replace(sequence, camera=camera), "euroc", tmp_path / "out")
    said = yaml_of(tmp_path / "out" / "mav0" / "cam0" / "sensor.yaml")
    assert said["distortion_model"] == model
    assert json.loads(said["distortion_coefficients"]) == coefficients


def test_euroc_inertial_readings(exported: dict[str, Path], plain: Sequence, tmp_path: Path) -> None:
    rows = listed(exported["euroc"] / "mav0" / "imu0" / "data.csv", ",")
    assert rows == [line.split(",")[:7] for line in IMU.splitlines()[1:]]
    export(plain, "euroc", tmp_path / "out")
    assert not (tmp_path / "out" / "mav0" / "imu0").exists()


# TUM and KITTI


def test_camera_truth_is_where_the_camera_is(sequence: Sequence) -> None:
    for frame in range(FRAMES):
        expected = sequence.true_cam_from_world(frame).inverse()
        np.testing.assert_allclose(camera_ground_truth(sequence).pose(frame).matrix, expected.matrix, atol=1e-12)
    np.testing.assert_array_equal(camera_ground_truth(sequence).stamps_ns, sequence.stamps_ns)


def test_tum_lists_images_depths_and_poses(sequence: Sequence, exported: dict[str, Path]) -> None:
    folder = exported["tum"]
    seconds = ["0.000000000", "0.066666666", "0.133333333", "0.200000000"]
    assert listed(folder / "rgb.txt", " ") == [[s, f"rgb/{s}.png"] for s in seconds]
    assert listed(folder / "depth.txt", " ") == [[s, f"depth/{s}.png"] for s in seconds]
    ground_truth = camera_ground_truth(sequence)
    rows = np.array(listed(folder / "groundtruth.txt", " "), dtype=float)
    np.testing.assert_allclose(rows[:, 1:4], ground_truth.positions_m, atol=1e-9)
    np.testing.assert_allclose(rows[:, [7, 4, 5, 6]], ground_truth.quaternions_wxyz, atol=1e-9)
    for frame, s in enumerate(seconds):
        assert (folder / "rgb" / f"{s}.png").read_bytes() == source(sequence, frame)
        depth = cv2.imread(str(folder / "depth" / f"{s}.png"), cv2.IMREAD_UNCHANGED)
        assert depth is not None and depth.dtype == np.uint16
        np.testing.assert_allclose(depth / 5000.0, drawn_depth(frame), atol=1e-4 + 1e-12)


def test_tum_depths_beyond_its_range_are_no_measurement(sequence: Sequence, tmp_path: Path) -> None:
    """13.107 m are the last of 65535 units of 0.2 mm; further is 0, not wrapped and not nearer than it is."""
    far = replace(sequence, camera=PINHOLE, info={**sequence.info, "depth_m_per_unit": 8 * DEPTH_UNIT_M})
    export(far, "tum", tmp_path / "out")
    depth = cv2.imread(str(tmp_path / "out" / "depth" / "0.000000000.png"), cv2.IMREAD_UNCHANGED)
    units = np.rint(5000 * 8 * drawn_depth(0))
    expected = np.where(units > 65535, 0, units)
    assert (expected > 0).any() and (units > 65535).any()
    np.testing.assert_array_equal(depth, expected)
    assert "further away and are 0" in (tmp_path / "out" / "README.md").read_text()
    near = replace(sequence, camera=PINHOLE)
    assert (5000 * drawn_depth(0) <= 65535).all()
    export(near, "tum", tmp_path / "near")
    assert "further away" not in (tmp_path / "near" / "README.md").read_text(), "nothing is lost"


def test_tum_of_a_sequence_without_depth_has_no_list_of_it(plain: Sequence, tmp_path: Path) -> None:
    export(plain, "tum", tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "README.md", "camera.txt", "croissant.json", "export.json", "groundtruth.txt", "rgb", "rgb.txt",
    ]  # fmt: skip


def test_kitti_has_times_a_projection_and_poses(sequence: Sequence, exported: dict[str, Path]) -> None:
    folder = exported["kitti"]
    np.testing.assert_allclose(np.loadtxt(folder / "times.txt"), sequence.stamps_ns / 1e9, atol=1e-12)
    rows = listed(folder / "calib.txt", " ")
    assert [row[0] for row in rows] == ["P0:", "P1:", "P2:", "P3:"]
    for row in rows:
        expected = np.column_stack([LENS.K, np.zeros(3)])
        np.testing.assert_allclose(np.array(row[1:], dtype=float).reshape(3, 4), expected)
    poses = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    expected = [camera_ground_truth(sequence).pose(k).matrix[:3] for k in range(FRAMES)]
    np.testing.assert_allclose(poses, expected, atol=1e-9)
    for frame in range(FRAMES):
        assert (folder / "image_2" / f"{frame:06d}.png").read_bytes() == source(sequence, frame)


# BOP


def bop(folder: Path, name: str) -> dict[str, list[dict[str, list[float]]]]:
    return json.loads((folder / "test" / "000001" / f"{name}.json").read_text())  # type: ignore[no-any-return]


def test_bop_poses_and_cameras_are_in_millimetres(sequence: Sequence, exported: dict[str, Path]) -> None:
    ground_truth, cameras = bop(exported["bop"], "scene_gt"), bop(exported["bop"], "scene_camera")
    assert list(ground_truth) == list(cameras) == [str(k) for k in range(FRAMES)]
    for frame in range(FRAMES):
        pose, camera = sequence.true_cam_from_world(frame), cameras[str(frame)]
        (one,) = ground_truth[str(frame)]
        assert one["obj_id"] == 1
        np.testing.assert_allclose(np.reshape(one["cam_R_m2c"], (3, 3)), pose.rotation, atol=1e-12)
        np.testing.assert_allclose(one["cam_t_m2c"], 1000 * pose.translation, atol=1e-9)
        np.testing.assert_allclose(camera["cam_R_w2c"], one["cam_R_m2c"])  # type: ignore[call-overload]
        np.testing.assert_allclose(camera["cam_t_w2c"], one["cam_t_m2c"])  # type: ignore[call-overload]
        np.testing.assert_allclose(np.reshape(camera["cam_K"], (3, 3)), LENS.K)  # type: ignore[call-overload]
        image = exported["bop"] / "test" / "000001" / "rgb" / f"{frame:06d}.png"
        assert image.read_bytes() == source(sequence, frame)
    assert json.loads((exported["bop"] / "camera.json").read_text()) == {
        "cx": 161.0, "cy": 118.5, "depth_scale": 1.0, "fx": 230.0, "fy": 235.0, "height": 240, "width": 320,
    }  # fmt: skip


def test_the_bop_model_is_the_structure_in_millimetres(sequence: Sequence, exported: dict[str, Path]) -> None:
    import trimesh

    mesh = trimesh.load(exported["bop"] / "models" / "obj_000001.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, 1000 * sequence.structure.vertices, atol=1e-3)
    np.testing.assert_array_equal(mesh.faces, sequence.structure.triangles)
    info = json.loads((exported["bop"] / "models" / "models_info.json").read_text())["1"]
    assert info == pytest.approx(
        {"diameter": np.sqrt(600**2 + 400**2 + 500**2), "min_x": -300, "min_y": -200, "min_z": 0,
         "size_x": 600, "size_y": 400, "size_z": 500}
    )  # fmt: skip


def test_bop_depths_at_the_last_unit_of_16_bits_are_kept(sequence: Sequence, tmp_path: Path) -> None:
    """65.535 m is 65535 units of 1 mm; 65.536 m would be 65536, which is nothing again when wrapped."""
    folder = tmp_path / "sequence"
    shutil.copytree(sequence.folder, folder)
    for frame in range(FRAMES):
        units = np.full((240, 320), 65535, np.uint16)
        units[:, :100] = 65536 // 2
        cv2.imwrite(str(folder / "depth" / f"{frame:06d}.png"), units)
    for unit_m, expected in ((0.001, 65535), (0.001 * 65536 / 65535, 0)):
        loaded = Sequence.load(folder)
        far = replace(loaded, camera=PINHOLE, info={**loaded.info, "depth_m_per_unit": unit_m})
        out = tmp_path / f"{expected}"
        export(far, "bop", out)
        depth = cv2.imread(str(out / "test" / "000001" / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
        assert depth is not None and (depth[:, 100:] == expected).all()
        assert np.abs(depth[:, :100].astype(int) - 32768).max() <= 1


@pytest.mark.parametrize("factor", [1.0, 2.19, 30.0, 60.0])
def test_bop_depths_are_in_millimetres_and_unknown_where_16_bits_end(
    sequence: Sequence, tmp_path: Path, factor: float
) -> None:
    """16 bits of 1 mm reach to 65.5 m; what is further is unknown, never wrapped."""
    far = replace(sequence, camera=PINHOLE, info={**sequence.info, "depth_m_per_unit": factor * DEPTH_UNIT_M})
    export(far, "bop", tmp_path / "out")
    assert bop(tmp_path / "out", "scene_camera")["0"]["depth_scale"] == 1.0  # type: ignore[call-overload]
    depth = cv2.imread(str(tmp_path / "out" / "test" / "000001" / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert depth is not None and depth.dtype == np.uint16
    units = np.rint(1000 * factor * drawn_depth(0))
    np.testing.assert_allclose(depth, np.where(units > 65535, 0, units), atol=1)  # where halves are rounded
    (info,) = bop(tmp_path / "out", "scene_gt_info")["0"]
    mask = cv2.imread(str(tmp_path / "out" / "test" / "000001" / "mask" / "000000_000000.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None and info["px_count_valid"] == ((mask > 0) & (depth > 0)).sum()


def test_bop_boxes_and_counts_are_those_of_outline_and_mask(sequence: Sequence, exported: dict[str, Path]) -> None:
    infos = bop(exported["bop"], "scene_gt_info")
    for frame in range(FRAMES):
        mask = np.zeros((240, 320), np.uint8)
        mask[100 + frame : 140, 150:180] = 255
        path = exported["bop"] / "test" / "000001" / "mask_visib" / f"{frame:06d}_000000.png"
        np.testing.assert_array_equal(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), mask)
        pixels = PINHOLE.project(sequence.true_cam_from_world(frame).transform(sequence.structure.vertices))
        hull = cv2.convexHull(pixels.astype(np.float32))
        inside = [[cv2.pointPolygonTest(hull, (u, v), False) >= 0 for u in range(320)] for v in range(240)]
        area = int((np.array(inside) | (mask > 0)).sum())
        (info,) = infos[str(frame)]
        x, y, w, h = info["bbox_obj"]
        np.testing.assert_allclose([x, y, x + w, y + h], [*pixels.min(axis=0), *pixels.max(axis=0)], atol=1)
        silhouette = exported["bop"] / "test" / "000001" / "mask" / f"{frame:06d}_000000.png"
        whole = cv2.imread(str(silhouette), cv2.IMREAD_GRAYSCALE)
        assert whole is not None and info["px_count_all"] == (whole > 0).sum()
        assert info["px_count_valid"] == info["px_count_all"] == pytest.approx(area, rel=0.02)
        assert info["bbox_visib"] == [150, 100 + frame, 29, 39 - frame]
        assert info["px_count_visib"] == 30 * (40 - frame)
        assert info["visib_fract"] == info["px_count_visib"] / info["px_count_all"]  # type: ignore[operator]


def area(triangles: Array) -> float:
    sides = triangles[:, 1:] - triangles[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)


@pytest.mark.parametrize("near_m", [-3.0, 0.0, 2.0, 4.999])
@pytest.mark.parametrize("turned", [False, True])
def test_of_a_face_that_reaches_behind_the_camera_bop_draws_what_lies_before_it(near_m: float, turned: bool) -> None:
    x0, x1, z0, z1 = -4.0, 6.0, -5.0, 5.0
    corners = np.array([[x0, 1.0, z0], [x1, 1.0, z0], [x1, 1.0, z1], [x0, 1.0, z1]])
    triangles = corners[np.array([[0, 1, 2], [0, 2, 3]])][:, :: -1 if turned else 1]
    kept = beyond(triangles, near_m)
    assert kept[..., 2].min() == pytest.approx(near_m)
    assert area(kept) == pytest.approx((x1 - x0) * (z1 - near_m))
    assert np.isin(np.round(kept[..., 0], 9), [x0, x1, round(x0 + (near_m - z0), 9)]).all()
    assert len(beyond(triangles, 5.001)) == 0 and np.array_equal(beyond(triangles, -5.001), triangles)


def test_bounds_and_deviation_of_the_structure_are_told_as_left_out(plain: Sequence, tmp_path: Path) -> None:
    shutil.copytree(plain.folder, tmp_path / "built")
    (tmp_path / "built" / "crlb.csv").write_text("frame\n")
    built = rewrite(Sequence.load(tmp_path / "built"), deviation={"scale": 0.0, "bend_m": 0.002})
    for name in ("tum", "euroc"):
        told = " ".join(export(built, name, tmp_path / name))
        assert "`crlb.csv` are not included" in told and "structure as built" in told
        told = " ".join(export(plain, name, tmp_path / f"{name}-plain"))
        assert "crlb" not in told and "structure as built" not in told


def test_bop_of_a_sequence_without_depth_and_mask(plain: Sequence, tmp_path: Path) -> None:
    """What is seen and what is measured is not known then, and not said; a structure out of view has no box."""
    export(plain, "bop", tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out" / "test" / "000001").iterdir()) == [
        "mask", "rgb", "scene_camera.json", "scene_gt.json", "scene_gt_info.json", "timestamps.csv",
    ]  # fmt: skip
    (info,) = bop(tmp_path / "out", "scene_gt_info")["1"]
    assert set(info) == {"bbox_obj", "px_count_all"}
    assert info["bbox_obj"] != [-1, -1, -1, -1]
    assert bop(tmp_path / "out", "scene_camera")["1"]["depth_scale"] == 1.0  # type: ignore[call-overload]
    targets = json.loads((tmp_path / "out" / "test_targets_bop19.json").read_text())
    assert [target["im_id"] for target in targets] == [0, 1]
    behind = Pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3)) @ CAM_FROM_BODY
    export(rewrite(plain, cam_from_body=behind.matrix.tolist()), "bop", tmp_path / "away")
    (info,) = bop(tmp_path / "away", "scene_gt_info")["1"]
    assert info == {"bbox_obj": [-1, -1, -1, -1], "px_count_all": 0}
    assert json.loads((tmp_path / "away" / "test_targets_bop19.json").read_text()) == []
    rewrite(plain, cam_from_body=CAM_FROM_BODY.matrix.tolist())


# Video, and all of them


def test_the_overlay_is_the_video_with_lines_on_it(sequence: Sequence, exported: dict[str, Path]) -> None:
    frames = {}
    for name in ("video.mp4", "overlay.mp4"):
        film = cv2.VideoCapture(str(exported["video"] / name))
        assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(15.0)
        images = []
        while (read := film.read())[0]:
            images.append(read[1].astype(float))
        assert len(images) == FRAMES
        frames[name] = images
    for frame in range(FRAMES):
        clean = sequence.image(frame).astype(float)
        assert np.abs(frames["video.mp4"][frame] - clean).mean() < 8
        drawn = np.abs(frames["overlay.mp4"][frame] - frames["video.mp4"][frame]).max(axis=2)
        assert 0.001 < (drawn > 60).mean() < 0.2


class NoWriter:
    """The writer of a build of OpenCV without the codec: it takes all images, and writes none."""

    fourcc = cv2.VideoWriter.fourcc

    def __init__(self, *asked: object) -> None:
        pass

    def isOpened(self) -> bool:
        return False

    def write(self, image: object) -> None:
        pass

    def release(self) -> None:
        pass


def test_a_video_that_opencv_cannot_write_is_refused(
    sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "VideoWriter", NoWriter)
    with pytest.raises(UserError, match=r"video\.mp4: this build of OpenCV cannot write vp09"):
        export(sequence, "video", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("width", "height", "told"), [(319, 240, "column"), (320, 239, "row"), (319, 239, "column and row"), (320, 240, "")]
)
def test_a_video_that_lacks_the_last_column_or_row_says_so(
    plain: Sequence, tmp_path: Path, width: int, height: int, told: str
) -> None:
    """Codecs halve the sides for the colours, and OpenCV leaves out what is odd."""
    shutil.copytree(plain.folder, tmp_path / "cut")
    for path in (tmp_path / "cut" / "frames").iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path))[:height, :width])
    camera = replace(plain.camera, width=width, height=height)
    not_held = export(replace(plain, folder=tmp_path / "cut", camera=camera), "video", tmp_path / "out")
    film = cv2.VideoCapture(str(tmp_path / "out" / "video.mp4"))
    assert (film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (width & ~1, height & ~1)
    assert (f"the last {told} of each image is left out" in " ".join(not_held)) == bool(told)


def test_without_an_imu_no_biases_are_told(plain: Sequence, tmp_path: Path) -> None:
    export(plain, "euroc", tmp_path / "out")
    assert "imu0" not in (tmp_path / "out" / "README.md").read_text()


def test_a_video_without_distortion_shows_the_images_of_the_pinhole(sequence: Sequence, tmp_path: Path) -> None:
    wide = replace(sequence, camera=Camera(320, 240, 230.0, 235.0, 161.0, 118.5, "radtan", (-0.5, 0.1, 0.0, 0.0)))
    export(wide, "video", tmp_path / "out", undistort=True)
    export(wide, "transforms", tmp_path / "images", undistort=True)
    film = cv2.VideoCapture(str(tmp_path / "out" / "video.mp4"))
    image = film.read()[1].astype(float)
    wanted = cv2.imread(str(tmp_path / "images" / "images" / "000000.png")).astype(float)
    differing = [(np.abs(image - other).max(axis=2) > 30).mean() for other in (wanted, sequence.image(0))]
    assert differing[0] < 0.001 < 0.01 < differing[1]
    assert "the images, undistorted" in (tmp_path / "out" / "README.md").read_text()


@pytest.mark.parametrize("format", ["tum", "kitti", "bop"])
def test_a_fisheye_is_no_pinhole_where_all_its_coefficients_are_zero(
    sequence: Sequence, tmp_path: Path, format: str
) -> None:
    fisheye = replace(sequence, camera=replace(PINHOLE, distortion_model="equidistant", distortion=(0.0,) * 4))
    with pytest.raises(UserError, match=r"equidistant .*add --undistort"):
        export(fisheye, format, tmp_path / format)
    radtan = replace(sequence, camera=replace(PINHOLE, distortion_model="radtan", distortion=(0.0,) * 4))
    export(radtan, format, tmp_path / format)


@pytest.mark.parametrize(
    ("format", "images"), [("bop", "test/000001/rgb"), ("colmap", "images"), ("transforms", "images")]
)
def test_the_stamps_of_numbered_images_are_beside_them(tmp_path: Path, format: str, images: str) -> None:
    """A frame was dropped between the second and the third, which their numbers do not tell."""
    made = make_sequence(tmp_path / "arc", 4)
    step = int(made.stamps_ns[1] - made.stamps_ns[0])
    for gap in (0, step):
        stamps = made.stamps_ns + np.array([0, 0, gap, gap])
        for name in ("frames.csv", "groundtruth.csv"):
            text = (made.folder / name).read_text()
            for ns, later in reversed([*zip(made.stamps_ns.tolist(), stamps.tolist(), strict=True)]):
                text = re.sub(rf",{ns},", f",{later},", text)
            (made.folder / name).write_text(text)
        out = tmp_path / str(gap)
        export(Sequence.load(made.folder), format, out)
        if format != "transforms":
            rows = listed((out / images).parent / "timestamps.csv", ",")
            assert [int(ns) for ns, _ in rows] == stamps.tolist()
            assert [name for _, name in rows] == sorted(path.name for path in (out / images).iterdir())
            assert "timestamps.csv" in json.loads((out / "export.json").read_text())["not_held"][0]
        doubts = doubts_of_times(out / images, 1e9 / step)
        assert len(doubts) == bool(gap) and all("seems to hold the times" in doubt for doubt in doubts)


def test_the_command_knows_every_format() -> None:
    assert list(EXPORTS) == NAMED


def test_a_folder_that_is_not_empty_is_refused_and_left_alone(sequence: Sequence, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("precious")
    with pytest.raises(UserError, match="is not empty"):
        export(undistorted(sequence, "tum"), "tum", tmp_path / "out")
    assert [p.read_text() for p in (tmp_path / "out").iterdir()] == ["precious"]
    (tmp_path / "empty").mkdir()
    export(undistorted(sequence, "kitti"), "kitti", tmp_path / "empty")
    assert (tmp_path / "empty" / "poses.txt").is_file()
    with pytest.raises(UserError, match="unknown export format"):
        export(sequence, "euroq", tmp_path / "x")


@pytest.mark.parametrize("format", sorted(set(EXPORTS) - {"kalibr"}))  # which takes no images
def test_an_image_that_was_cut_off_is_named(sequence: Sequence, tmp_path: Path, format: str) -> None:
    shutil.copytree(sequence.folder, tmp_path / "arc")
    image = tmp_path / "arc" / sequence.files[1]
    image.write_bytes(image.read_bytes()[:200])
    plain = replace(Sequence.load(tmp_path / "arc"), camera=PINHOLE)
    with pytest.raises(UserError, match=image.name):
        export(plain, format, tmp_path / "out")
    assert not (tmp_path / "out").exists()
