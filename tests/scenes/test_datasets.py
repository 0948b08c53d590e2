import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from evo.tools import file_interface

from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.annotations import EDGE_COLUMNS, load_edges, read_depth
from uavbench.scenes.dataset.contact_sheet import LEGEND_PX, contact_sheet, write_contact_sheet
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import compare, verify, write_manifest
from uavbench.scenes.effects.exposure import RollingShutter
from uavbench.scenes.exports.registry import camera_ground_truth, export
from uavbench.scenes.generate import generate
from uavbench.scenes.spec import CameraSpec, SequenceSpec
from uavbench.scenes.structures.box import Box
from uavbench.scenes.world.indoor import Indoor
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.sensors.registry import SENSORS
from uavbench.trajectories.simulation.flight import FlightSpec
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import read_euroc, read_kitti, read_tum

SPEC = SequenceSpec(
    name="data",
    seed=2,
    structure=Box(),
    environment=Indoor(floor="concrete"),
    flight=FlightSpec(path=HandPilot(duration_s=0.35)),
    mount=Mount(pitch_deg=-3.0, offset_m=(0.02, 0.0, 0.01)),
    camera=CameraSpec(width=320, height=240, horizontal_fov_deg=65.0),
    sensors=(SENSORS["imu"](),),
    annotations=("depth", "mask", "edges"),
)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("datasets") / "data"
    generate(SPEC, folder, content_hash="abc")
    return Sequence.load(folder)


def same(a: Trajectory, b: Trajectory) -> None:
    assert np.abs(a.stamps_ns - b.stamps_ns).max() <= 1
    assert a.positions_m == pytest.approx(b.positions_m, abs=1e-6)
    assert np.abs(np.einsum("ij,ij->i", a.quaternions_wxyz, b.quaternions_wxyz)) == pytest.approx(
        np.ones(len(a)), abs=1e-9
    )


def test_depth_is_that_of_the_model(sequence: Sequence) -> None:
    """At the middle of each face that is seen, the depth image says what geometry says."""
    structure, checked = sequence.structure, 0
    for frame in range(len(sequence)):
        pose, depth = sequence.true_cam_from_world(frame), read_depth(sequence, frame)
        for face, normal in enumerate(structure.face_normals):
            middle = structure.vertices[structure.triangles[structure.triangle_face == face]].mean(axis=(0, 1))
            point = pose.transform(middle[None])
            if (pose.rotation @ normal) @ point[0] < -0.2 * np.linalg.norm(point):
                u, v = np.rint(sequence.camera.project(point)[0]).astype(int)
                assert depth[v, u] == pytest.approx(point[0, 2], abs=0.03)
                checked += 1
    assert checked >= 10


def test_the_mask_is_the_projected_outline(sequence: Sequence) -> None:
    mask = cv2.imread(str(sequence.folder / "mask" / "000002.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    outline = np.zeros(mask.shape, dtype=np.uint8)
    pixels = sequence.camera.project(sequence.true_cam_from_world(2).transform(sequence.structure.vertices))
    cv2.fillConvexPoly(outline, cv2.convexHull(np.rint(pixels).astype(np.int32)), 1)
    assert ((mask == 1) & (outline == 1)).sum() / ((mask == 1) | (outline == 1)).sum() > 0.95


def test_visible_edges_are_those_of_the_faces_seen(sequence: Sequence) -> None:
    structure = sequence.structure
    for frame in range(len(sequence)):
        pose = sequence.true_cam_from_world(frame)
        eye = pose.inverse().translation
        centres = np.array(
            [structure.vertices[structure.triangles[structure.triangle_face == f]].mean(axis=(0, 1)) for f in range(6)]
        )
        front = np.einsum("ij,ij->i", structure.face_normals, eye - centres) > 0
        expected = set(np.flatnonzero(front[structure.edge_faces].any(axis=1)).tolist())
        rows = load_edges(sequence, frame)
        whole = rows[rows[:, EDGE_COLUMNS.index("visible_share")] > 0.5]
        assert set(whole[:, 0].astype(int).tolist()) == expected
        ends = sequence.camera.project(pose.transform(structure.edge_segments.reshape(-1, 3))).reshape(-1, 2, 2)
        for row in rows[rows[:, 5] > 0.999]:
            got, want = row[1:5].reshape(2, 2), ends[int(row[0])]
            assert np.abs(got - want).max() < 0.01
        assert (rows[:, 6] > 0).all()


def test_edge_truth_lies_on_the_rendered_edge(sequence: Sequence) -> None:
    """Across an edge of the outline the mask changes within a pixel of where the ground truth says."""
    mask = cv2.imread(str(sequence.folder / "mask" / "000000.png"), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    outline = cv2.morphologyEx((mask == 1).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), dtype=np.uint8))
    hits = [
        outline[round(v), round(u)]
        for row in load_edges(sequence, 0)
        for u, v in np.linspace(row[1:3], row[3:5], 20)[2:-2]
    ]
    assert np.mean(hits) > 0.5


def test_a_rolling_shutter_leaves_the_pose_of_every_row(tmp_path: Path) -> None:
    spec = replace(SPEC, effects=(RollingShutter(readout_ms=24.0),), annotations=())
    generate(spec, tmp_path / "rolling", content_hash="abc")
    sequence = Sequence.load(tmp_path / "rolling")
    rows = np.load(tmp_path / "rolling" / "row_poses.npy")
    assert rows.shape == (len(sequence), 240, 7)
    middle = (rows[:, 119] + rows[:, 120]) / 2
    assert middle[:, :3] == pytest.approx(sequence.ground_truth.positions_m, abs=1e-5)
    speed = np.linalg.norm(rows[:, -1, :3] - rows[:, 0, :3], axis=1) / 0.024
    assert speed == pytest.approx(np.linalg.norm(sequence.ground_truth_table[:, 9:12], axis=1), rel=0.2)
    assert sequence.info["row_delay_ns"] == pytest.approx(24e6 / 239)
    assert Camera.load(tmp_path / "rolling" / "camera.toml") == sequence.camera


def test_evo_and_we_read_the_tum_export(sequence: Sequence, tmp_path: Path) -> None:
    export(sequence, "tum", tmp_path / "tum")
    same(read_tum(tmp_path / "tum" / "groundtruth.txt"), camera_ground_truth(sequence))
    evo = file_interface.read_tum_trajectory_file(str(tmp_path / "tum" / "groundtruth.txt"))
    assert evo.positions_xyz == pytest.approx(camera_ground_truth(sequence).positions_m, abs=1e-6)
    line = (tmp_path / "tum" / "depth.txt").read_text().splitlines()[1].split()
    depth = cv2.imread(str(tmp_path / "tum" / line[1]), cv2.IMREAD_UNCHANGED)
    assert depth / 5000.0 == pytest.approx(read_depth(sequence, 0), abs=2e-4)


def test_evo_and_we_read_the_euroc_export(sequence: Sequence, tmp_path: Path) -> None:
    export(sequence, "euroc", tmp_path / "euroc")
    ground_truth = tmp_path / "euroc" / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    written = read_euroc(ground_truth)
    same(written.select(np.isin(written.stamps_ns, sequence.stamps_ns)), sequence.ground_truth)
    evo = file_interface.read_euroc_csv_trajectory(str(ground_truth))
    assert evo.positions_xyz == pytest.approx(written.positions_m, abs=1e-6)
    stamp = int(sequence.stamps_ns[1])
    assert (tmp_path / "euroc" / "mav0" / "cam0" / "data" / f"{stamp}.png").is_file()
    imu = (tmp_path / "euroc" / "mav0" / "imu0" / "data.csv").read_text().splitlines()
    assert len(imu[1].split(",")) == 7
    assert float(imu[1].split(",")[6]) == pytest.approx(9.8, abs=2.0)
    camera = cv2.FileStorage(str(tmp_path / "x.yaml"), cv2.FILE_STORAGE_WRITE)
    camera.release()
    text = (tmp_path / "euroc" / "mav0" / "cam0" / "sensor.yaml").read_text()
    assert f"resolution: [{sequence.camera.width}, {sequence.camera.height}]" in text


def test_evo_and_we_read_the_kitti_export(sequence: Sequence, tmp_path: Path) -> None:
    export(sequence, "kitti", tmp_path / "kitti")
    ours = read_kitti(tmp_path / "kitti" / "poses.txt")
    assert ours.positions_m == pytest.approx(camera_ground_truth(sequence).positions_m, abs=1e-6)
    evo = file_interface.read_kitti_poses_file(str(tmp_path / "kitti" / "poses.txt"))
    assert evo.positions_xyz == pytest.approx(camera_ground_truth(sequence).positions_m, abs=1e-6)


def test_the_bop_export_has_its_layout_and_millimetres(sequence: Sequence, tmp_path: Path) -> None:
    export(sequence, "bop", tmp_path / "bop")
    scene = tmp_path / "bop" / "test" / "000001"
    pose = json.loads((scene / "scene_gt.json").read_text())["1"][0]
    true = sequence.true_cam_from_world(1)
    assert np.array(pose["cam_R_m2c"]).reshape(3, 3) == pytest.approx(true.rotation, abs=1e-12)
    assert np.array(pose["cam_t_m2c"]) / 1000 == pytest.approx(true.translation, abs=1e-9)
    camera = json.loads((scene / "scene_camera.json").read_text())["1"]
    depth = cv2.imread(str(scene / "depth" / "000001.png"), cv2.IMREAD_UNCHANGED) * camera["depth_scale"] / 1000
    assert depth == pytest.approx(read_depth(sequence, 1), abs=1e-3)
    info = json.loads((scene / "scene_gt_info.json").read_text())["1"][0]
    assert info["visib_fract"] > 0.95
    x, y, w, h = info["bbox_visib"]
    mask = cv2.imread(str(scene / "mask_visib" / "000001_000000.png"), cv2.IMREAD_GRAYSCALE)
    assert mask[y : y + h + 1, x : x + w + 1].astype(bool).sum() == mask.astype(bool).sum() == info["px_count_visib"]
    models = json.loads((tmp_path / "bop" / "models" / "models_info.json").read_text())["1"]
    assert models["size_x"] == pytest.approx(400.0)
    assert models["diameter"] == pytest.approx(1000 * np.sqrt(0.4**2 + 0.3**2 + 0.3**2))


def test_the_video_has_every_frame(sequence: Sequence, tmp_path: Path) -> None:
    export(sequence, "video", tmp_path / "video")
    for name in ("video.mp4", "overlay.mp4"):
        film = cv2.VideoCapture(str(tmp_path / "video" / name))
        assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == len(sequence)
        film.release()


def test_an_unknown_export_names_the_nearest(sequence: Sequence, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"unknown export format 'euroq'; did you mean 'euroc'"):
        export(sequence, "euroq", tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_verify_finds_what_was_changed(sequence: Sequence, tmp_path: Path) -> None:
    import shutil

    assert verify(sequence.folder).ok
    copy = tmp_path / "copy"
    shutil.copytree(sequence.folder, copy)
    (copy / "groundtruth.csv").write_text("x")
    (copy / "frames" / "000001.png").unlink()
    (copy / "extra.txt").write_text("x")
    verdict = verify(copy)
    assert verdict.method == "hash"
    assert verdict.problems == (
        "extra.txt: is not in the manifest",
        "frames/000001.png: is missing",
        "groundtruth.csv: has changed since it was written",
    )


def list_anew(folder: Path) -> None:
    """Write its manifest as if it had been rendered so; what is there already is not overwritten."""
    (folder / "manifest.json").unlink()
    write_manifest(folder)


def test_two_renders_are_compared_by_hash_then_by_tolerance(sequence: Sequence, tmp_path: Path) -> None:
    import shutil

    assert compare(sequence.folder, sequence.folder).method == "hash"
    again = tmp_path / "again"
    shutil.copytree(sequence.folder, again)
    image = cv2.imread(str(again / "frames" / "000000.png"))
    assert image is not None
    cv2.imwrite(str(again / "frames" / "000000.png"), np.clip(image.astype(int) + 2, 0, 255).astype(np.uint8))
    list_anew(again)
    close = compare(sequence.folder, again)
    assert close.ok
    assert close.method == "tolerance"
    cv2.imwrite(str(again / "frames" / "000000.png"), image // 2)
    list_anew(again)
    assert "differ by more than 3 levels" in compare(sequence.folder, again).problems[0]
    (again / "groundtruth.csv").write_text("x")
    list_anew(again)
    assert any(p.startswith("groundtruth.csv: differs") for p in compare(sequence.folder, again).problems)


def changed(path: Path, pixels: int, by: int) -> None:
    """Add to the first pixels of a file's middle row."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    image[len(image) // 2, :pixels] += np.asarray(by, dtype=image.dtype)
    cv2.imwrite(str(path), image)


def test_a_folder_that_changed_is_not_the_rendering_that_its_manifest_names(sequence: Sequence, tmp_path: Path) -> None:
    again = tmp_path / "again"
    shutil.copytree(sequence.folder, again)
    (again / "imu.csv").unlink()
    (again / "groundtruth.csv").write_text("changed\n", encoding="utf-8")
    told = ("imu.csv: is missing", "groundtruth.csv: has changed since it was written")
    assert sorted(compare(again, sequence.folder).problems) == sorted(told)
    assert sorted(compare(sequence.folder, again).problems) == sorted(f"{again}: {each}" for each in told)


@pytest.mark.parametrize(
    ("folder", "little", "much", "told"),
    [
        ("depth", (320, 1), (200, 3), "0.260 % of its pixels differ by more than 1 mm and 0.01 %"),
        ("mask", (70, 1), (80, 1), "0.104 % of its pixels differ"),
    ],
)
def test_what_another_driver_renders_of_the_truth_is_compared_by_tolerance(
    sequence: Sequence,
    tmp_path: Path,
    folder: str,
    little: tuple[int, int],
    much: tuple[int, int],
    told: str,
) -> None:
    import shutil

    again = tmp_path / "again"
    shutil.copytree(sequence.folder, again)
    changed(again / folder / "000000.png", *little)
    list_anew(again)
    assert compare(sequence.folder, again).problems == (
        f"{folder}/000000.png: differs; ground truth and sensors must be byte-identical",
    )
    record = json.loads((again / "sequence.json").read_text())
    record["versions"]["gl"] = "the driver of a GPU"
    record["content_hash"] = "that of another build of a library"
    (again / "sequence.json").write_text(json.dumps(record))
    list_anew(again)
    verdict = compare(sequence.folder, again)
    assert verdict.ok
    assert verdict.method == "tolerance"
    changed(again / folder / "000000.png", *much)
    list_anew(again)
    assert compare(sequence.folder, again).problems == (f"{folder}/000000.png: {told}",)
    (again / "groundtruth.csv").write_text("x")
    list_anew(again)
    assert any(p.startswith("groundtruth.csv: differs") for p in compare(sequence.folder, again).problems)


def test_edges_of_two_drivers_are_compared_by_their_visible_lengths(sequence: Sequence, tmp_path: Path) -> None:
    import shutil

    again = tmp_path / "again"
    shutil.copytree(sequence.folder, again)
    record = json.loads((again / "sequence.json").read_text())
    record["versions"]["gl"] = "the driver of a GPU"
    (again / "sequence.json").write_text(json.dumps(record))
    head, *rows = (again / "edges" / "000000.csv").read_text().splitlines(keepends=True)
    (again / "edges" / "000000.csv").write_text(head + rows[0][:-2] + "7\n" + "".join(rows[1:]))
    list_anew(again)
    assert compare(sequence.folder, again).ok, "a contrast is that of the image"
    (again / "edges" / "000000.csv").write_text(head + "".join(rows[1:]))
    list_anew(again)
    (problem,) = compare(sequence.folder, again).problems
    assert "px of its edges are visible in only one of the two" in problem


def test_a_contact_sheet_is_one_picture(sequence: Sequence, tmp_path: Path) -> None:
    write_contact_sheet(sequence, tmp_path / "sheet.png")
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet is not None
    assert sheet.shape == (600 + LEGEND_PX, 1600, 3)


@pytest.mark.parametrize(("columns", "rows"), [(2, 3), (4, 2), (5, 2), (6, 1)])
def test_a_contact_sheet_of_few_frames_has_no_empty_row(sequence: Sequence, columns: int, rows: int) -> None:
    assert len(sequence) == 6
    height = round(100 * sequence.camera.height / sequence.camera.width)
    sheet = contact_sheet(sequence, columns, 3, 100)
    assert sheet.shape == (rows * height + LEGEND_PX, columns * 100, 3)
    assert sheet[(rows - 1) * height : rows * height, :100].std() > 5
