"""COLMAP and nerfstudio exports, opened by pycolmap and by a loader of nerfstudio's kind that knows nothing of ours.

What is expected is made from the CSV, JSON, TOML and PNG files of the dataset and OpenCV's projection alone.
"""

import csv
import json
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from tests.reports.drawn import CAM_FROM_BODY, make_sequence
from uavbench.bench.config.suite import load_suite
from uavbench.scenes.camera import Camera
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.exports.registry import export
from uavbench.scenes.generate import generate
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

FRAMES = 4
MOUNT = Pose.exp(np.array([0.05, -0.02, 0.1, 0.1, -0.2, 0.05])) @ CAM_FROM_BODY
"""A camera off the body's middle and turned against it, so that a pose is never its own inverse."""
LENSES = {
    "none": Camera(320, 240, 230.0, 235.0, 161.0, 118.5),
    "radtan": Camera(320, 240, 230.0, 235.0, 161.0, 118.5, "radtan", (-0.1, 0.02, 0.001, -0.002)),
    "radtan-k3": Camera(320, 240, 230.0, 235.0, 161.0, 118.5, "radtan", (-0.1, 0.02, 0.001, -0.002, 0.01)),
    "equidistant": Camera(320, 240, 230.0, 235.0, 161.0, 118.5, "equidistant", (0.02, -0.01, 0.003, -0.001)),
}
MODELS = {"none": "PINHOLE", "radtan": "OPENCV", "radtan-k3": "FULL_OPENCV", "equidistant": "OPENCV_FISHEYE"}
RENDERED = """
title = "t"
rates_hz = [5.0]
[sequences.a]
rate_hz = 15.0
structure = { kind = "box" }
environment = { kind = "indoor" }
mount = { pitch_deg = -33.0, yaw_deg = 6.0, roll_deg = 1.0, offset_m = [0.05, 0.02, -0.01] }
flight.path = { kind = "orbit", distance_m = 0.9, height_m = 1.0, turns = 0.02, speed_m_s = 0.5, acceleration_m_s2 = 3.0 }
camera = { width = 160, height = 120, horizontal_fov_deg = 65.0, distortion_model = "radtan", distortion = [-0.1, 0.02, 0.001, -0.002] }
annotations = ["depth", "mask"]
[trackers]
hold = { kind = "hold" }
"""  # noqa: E501


def rewritten(sequence: Sequence, camera: Camera) -> Sequence:
    """The sequence with another lens and MOUNT; its images stay."""
    (sequence.folder / "camera.toml").unlink()
    camera.save(sequence.folder / "camera.toml")
    info = {**sequence.info, "cam_from_body": MOUNT.matrix.tolist()}
    (sequence.folder / "sequence.json").write_text(json.dumps(info))
    return Sequence.load(sequence.folder)


@pytest.fixture(scope="module", params=LENSES)
def drawn(request, tmp_path_factory):
    """A sequence, the name of its lens, and its exports by format."""
    folder = tmp_path_factory.mktemp("drawn")
    sequence = rewritten(make_sequence(folder / "sequence", FRAMES), LENSES[request.param])
    for format in ("colmap", "transforms"):
        export(sequence, format, folder / format)
    return folder, request.param


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    (folder / "suite.toml").write_text(RENDERED)
    (spec,) = load_suite(folder / "suite.toml").sequences
    generate(spec, folder / "sequence", content_hash="abc")
    for format in ("colmap", "transforms"):
        export(Sequence.load(folder / "sequence"), format, folder / format)
        export(Sequence.load(folder / "sequence"), format, folder / f"{format}-straight", undistort=True)
    return folder


# The ground truth, by readers of this file's own


def cam_from_world(folder: Path) -> np.ndarray:
    """Matrices (n, 4, 4) at each image."""
    with (folder / "groundtruth.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    body = np.tile(np.eye(4), (len(rows), 1, 1))
    body[:, :3, :3] = Rotation.from_quat([[float(row[f"q{a}"]) for a in "xyzw"] for row in rows]).as_matrix()
    body[:, :3, 3] = [[float(row[f"p{a}_m"]) for a in "xyz"] for row in rows]
    return np.array(json.loads((folder / "sequence.json").read_text())["cam_from_body"]) @ np.linalg.inv(body)


def corners(folder: Path) -> np.ndarray:
    rows = [line.split()[1:4] for line in (folder / "model.obj").read_text().splitlines() if line.startswith("v ")]
    return np.array(rows, dtype=float)


def faces(folder: Path) -> np.ndarray:
    """Triangles (m, 3, 3) of the model."""
    lines = [line for line in (folder / "model.obj").read_text().splitlines() if line.startswith("f ")]
    return corners(folder)[[[int(word.split("/")[0]) - 1 for word in line.split()[1:]] for line in lines]]


def projected(folder: Path, points: np.ndarray, frame: int, distorted: bool = True) -> np.ndarray:
    """True pixels (n, 2), pixel centres at whole numbers, by OpenCV."""
    said = tomllib.loads((folder / "camera.toml").read_text())
    K = np.array([[said["fx"], 0, said["cx"]], [0, said["fy"], said["cy"]], [0, 0, 1.0]])
    T = cam_from_world(folder)[frame]
    turn, t = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3]
    lens = np.array(said["distortion"] if distorted and said["distortion"] else [0.0] * 4)
    if said["distortion_model"] == "equidistant" and distorted:
        return cv2.fisheye.projectPoints(points[:, None], turn, t, K, lens)[0].reshape(-1, 2)
    return cv2.projectPoints(points[:, None], turn, t, K, lens)[0].reshape(-1, 2)


# COLMAP


def test_corners_reproject_in_pycolmap_where_the_ground_truth_has_them(drawn):
    folder, lens = drawn
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse" / "0")
    assert [camera.model.name for camera in model.cameras.values()] == [MODELS[lens]]
    assert len(model.images) == FRAMES == model.num_reg_images()
    for image in model.images.values():
        frame = int(image.name.removesuffix(".png"))
        found = [image.project_point(corner) for corner in corners(folder / "sequence")]
        # COLMAP's first pixel has its centre at (0.5, 0.5), OpenCV's at (0, 0).
        wanted = projected(folder / "sequence", corners(folder / "sequence"), frame) + 0.5
        np.testing.assert_allclose(np.array(found), wanted, atol=1e-6)


def test_points_lie_on_the_model_and_are_observed_where_they_project_to(drawn):
    folder, _ = drawn
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse" / "0")
    points = np.array([point.xyz for point in model.points3D.values()])
    assert len(points) > 1000
    low, high = corners(folder / "sequence").min(axis=0), corners(folder / "sequence").max(axis=0)
    off = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1)
    assert off.max() < 1e-9 and (points > low - 1e-9).all() and (points < high + 1e-9).all()
    for image in model.images.values():
        observed = [(point.point3D_id, point.xy) for point in image.points2D]
        assert len(observed) > 300
        xyz = np.array([model.points3D[number].xyz for number, _ in observed])
        wanted = projected(folder / "sequence", xyz, int(image.name.removesuffix(".png"))) + 0.5
        np.testing.assert_allclose(np.array([xy for _, xy in observed]), wanted, atol=1e-5)
        assert (wanted > 0).all() and (wanted < [320, 240]).all()
        # The camera sees the top and one or two sides of the box, and no point through it.
        eye = -image.cam_from_world().rotation.matrix().T @ image.cam_from_world().translation
        seen_low, seen_high = eye < low, eye > high
        on = (np.abs(xyz - low) < 1e-9) & seen_low | (np.abs(xyz - high) < 1e-9) & seen_high
        assert on.any(axis=1).all()


def test_tracks_are_those_of_the_images(drawn):
    folder, _ = drawn
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse" / "0")
    assert model.compute_mean_reprojection_error() == 0.0
    for number, point in model.points3D.items():
        assert point.track.length() >= 1
        for element in point.track.elements:
            assert model.images[element.image_id].points2D[element.point2D_idx].point3D_id == number
    observations = sum(point.track.length() for point in model.points3D.values())
    assert observations == model.compute_num_observations() == sum(len(i.points2D) for i in model.images.values())
    image = cv2.imread(str(folder / "colmap" / "images" / "000000.png"))
    for point in image_points(model, "000000.png")[:200]:
        column, row = np.floor(point.xy).astype(int)
        np.testing.assert_array_equal(model.points3D[point.point3D_id].color, image[row, column, ::-1])


def image_points(model, name):
    return next(image for image in model.images.values() if image.name == name).points2D


def test_images_are_those_of_the_sequence(drawn):
    folder, _ = drawn
    for format in ("colmap", "transforms"):
        for frame in range(FRAMES):
            name = f"{frame:06d}.png"
            original = folder / "sequence" / "frames" / name
            assert (folder / format / "images" / name).read_bytes() == original.read_bytes()
        assert not (folder / format / "masks").exists()


# nerfstudio: a loader of its kind, written after its documentation of conventions


class Loaded:
    """Cameras of a transforms.json: rays through pixel coordinates, and back; the first pixel's centre: (0.5, 0.5)."""

    def __init__(self, folder: Path) -> None:
        self.meta = json.loads((folder / "transforms.json").read_text())
        self.frames = sorted(self.meta["frames"], key=lambda frame: frame["file_path"])
        self.lens = [self.meta.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")]
        for frame in self.frames:
            for key in ("file_path", "mask_path", "depth_file_path"):
                assert key not in frame or (folder / frame[key]).is_file()
        for key in ("mask_path", "depth_file_path"):
            assert sum(key in frame for frame in self.frames) in (0, len(self.frames))

    def distort(self, xy: np.ndarray) -> np.ndarray:
        k1, k2, k3, k4, p1, p2 = self.lens
        x, y = xy.T
        r2 = x * x + y * y
        if self.meta["camera_model"] == "OPENCV_FISHEYE":
            r = np.sqrt(r2)
            theta = np.arctan(r)
            t2 = theta * theta
            scale = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) / np.where(r > 0, r, 1.0)
            return np.column_stack([x * scale, y * scale])
        assert self.meta["camera_model"] == "OPENCV"
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        return np.column_stack(
            [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)]
        )

    def undistort(self, xy: np.ndarray) -> np.ndarray:
        found = xy.copy()
        for _ in range(200):
            found += xy - self.distort(found)
        return found

    def rays(self, frame: int, coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and directions (n, 3) in the world: x right, y up, z backward in the camera."""
        meta = self.meta
        xy = (coordinates - [meta["cx"], meta["cy"]]) / [meta["fl_x"], meta["fl_y"]]
        x, y = self.undistort(xy).T
        T = np.array(self.frames[frame]["transform_matrix"])
        directions = np.column_stack([x, -y, -np.ones(len(x))]) @ T[:3, :3].T
        return T[:3, 3], directions / np.linalg.norm(directions, axis=1)[:, None]

    def coordinates(self, frame: int, points: np.ndarray) -> np.ndarray:
        meta = self.meta
        x, y, z = np.linalg.inv(np.array(self.frames[frame]["transform_matrix"]))[:3] @ np.vstack(
            [points.T, np.ones(len(points))]
        )
        return self.distort(np.column_stack([x / -z, y / z])) * [meta["fl_x"], meta["fl_y"]] + [meta["cx"], meta["cy"]]


def test_a_loader_of_transforms_projects_corners_where_the_ground_truth_has_them(drawn):
    folder, _ = drawn
    loaded, points = Loaded(folder / "transforms"), corners(folder / "sequence")
    assert len(loaded.frames) == FRAMES
    for frame in range(FRAMES):
        wanted = projected(folder / "sequence", points, frame) + 0.5
        np.testing.assert_allclose(loaded.coordinates(frame, points), wanted, atol=1e-6)
        origin, directions = loaded.rays(frame, wanted)
        along = ((points - origin) * directions).sum(axis=1)
        assert (along > 0).all()
        np.testing.assert_allclose(origin + along[:, None] * directions, points, atol=1e-6)


def test_times_and_points_of_transforms(drawn):
    folder, _ = drawn
    loaded = Loaded(folder / "transforms")
    with (folder / "sequence" / "frames.csv").open(newline="") as handle:
        assert [frame["stamp_ns"] for frame in loaded.frames] == [int(r["stamp_ns"]) for r in csv.DictReader(handle)]
    import trimesh

    cloud = trimesh.load(folder / "transforms" / loaded.meta["ply_file_path"])
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse" / "0")
    points = [point for _, point in sorted(model.points3D.items())]
    np.testing.assert_allclose(cloud.vertices, [point.xyz for point in points], atol=1e-12)
    np.testing.assert_array_equal(cloud.colors[:, :3], [point.color for point in points])


def hit(origin: np.ndarray, directions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance (n,) to the first triangle along each ray, inf where there is none (Moeller & Trumbore 1997)."""
    out = np.full(len(directions), np.inf)
    for a, b, c in triangles:
        h = np.cross(directions, c - a)
        det = h @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = h @ (origin - a) / det
            q = np.cross(origin - a, b - a)
            v, t = directions @ q / det, (c - a) @ q / det
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        out = np.where(inside & (t < out), t, out)
    return out


@pytest.mark.parametrize(("name", "most_differing"), [("transforms", 0), ("transforms-straight", 26)])
def test_rays_of_the_loader_meet_the_model_where_the_rendering_shows_it(rendered, name, most_differing):
    """Half a pixel, an axis or a lens the wrong way would be seen: 41 pixels and more differ then.

    Without the lens the mask is that of the lens at the nearest pixel: so much of its border is a pixel further out.
    """
    loaded = Loaded(rendered / name)
    v, u = np.mgrid[0:120, 0:160]
    origin, directions = loaded.rays(0, np.column_stack([u.ravel(), v.ravel()]) + 0.5)
    far = hit(origin, directions, faces(rendered / "sequence")).reshape(120, 160)
    frame = loaded.frames[0]
    mask = cv2.imread(str(rendered / name / frame["mask_path"]), cv2.IMREAD_GRAYSCALE)
    assert set(np.unique(mask)) == {0, 255} and (mask > 0).sum() > 1000
    assert ((mask > 0) != np.isfinite(far)).sum() <= most_differing
    depth = cv2.imread(str(rendered / name / frame["depth_file_path"]), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    backward = np.array(frame["transform_matrix"])[:3, 2]
    along_axis = far * (directions @ -backward).reshape(120, 160)
    inner = cv2.erode(mask, np.ones((5, 5))) > 0
    np.testing.assert_allclose(depth[inner] / 1000, along_axis[inner], atol=0.004)


def test_masks_are_where_the_tools_look_for_them(rendered):
    assert min(p.name for p in (rendered / "colmap" / "masks").iterdir()) == "000000.png.png"
    for path in sorted((rendered / "sequence" / "mask").iterdir()):
        original = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for copy in (f"colmap/masks/{path.name}.png", f"transforms/masks/{path.name}"):
            found = cv2.imread(str(rendered / copy), cv2.IMREAD_GRAYSCALE)
            np.testing.assert_array_equal(found, np.where(original == 1, 255, 0))


def test_a_depth_beyond_16_bits_of_millimetres_is_none_and_never_wrapped(tmp_path):
    sequence = make_sequence(tmp_path / "sequence", 2)
    (sequence.folder / "depth").mkdir(exist_ok=True)
    units = np.full((240, 320), 30000, np.uint16)  # 60 m
    units[:, 100:200], units[:, 200:] = 35000, 0  # 70 m, which would be 4.5 m, and none
    for frame in range(2):
        cv2.imwrite(str(sequence.folder / "depth" / f"{frame:06d}.png"), units)
    (sequence.folder / "sequence.json").write_text(json.dumps({**sequence.info, "depth_m_per_unit": 0.002}))
    export(Sequence.load(sequence.folder), "transforms", tmp_path / "out")
    depth = cv2.imread(str(tmp_path / "out" / "depths" / "000001.png"), cv2.IMREAD_UNCHANGED)
    assert (depth.dtype, np.unique(depth).tolist()) == (np.uint16, [0, 60000])
    assert (depth[:, :100] == 60000).all()


def test_a_point_behind_something_else_is_not_observed(tmp_path):
    sequence = make_sequence(tmp_path / "sequence", 2)
    (sequence.folder / "mask").mkdir()
    mask = np.full((240, 320), 3, np.uint8)  # people
    mask[:, :150] = 1
    for frame in range(2):
        cv2.imwrite(str(sequence.folder / "mask" / f"{frame:06d}.png"), mask)
    export(sequence, "colmap", tmp_path / "colmap")
    model = pycolmap.Reconstruction(tmp_path / "colmap" / "sparse" / "0")
    places = np.array([point.xy for image in model.images.values() for point in image.points2D])
    assert len(places) > 300 and 149 < places[:, 0].max() <= 150


def test_undistorted_exports_are_of_a_pinhole(rendered):
    model = pycolmap.Reconstruction(rendered / "colmap-straight" / "sparse" / "0")
    assert next(iter(model.cameras.values())).model.name == "PINHOLE"
    points = corners(rendered / "sequence")
    for image in model.images.values():
        found = np.array([image.project_point(corner) for corner in points])
        wanted = projected(rendered / "sequence", points, int(image.name[:6]), distorted=False) + 0.5
        np.testing.assert_allclose(found, wanted, atol=1e-6)
    meta = Loaded(rendered / "transforms-straight").meta
    assert (meta["camera_model"], meta["k1"], meta["p2"]) == ("OPENCV", 0.0, 0.0)


@pytest.mark.parametrize("format", ["colmap", "transforms"])
def test_notes_say_what_is_not_held(rendered, drawn, format):
    folder, _ = drawn
    (readme,) = [(where / format / "README.md").read_text() for where in (folder,)]
    assert "the first pixel's centre at (0.5, 0.5)" in readme
    assert ("y up, z backward" if format == "transforms" else "y down, z forward") in readme
    told = json.loads((folder / format / "export.json").read_text())["not_held"]
    assert any("behind trees, people" in line for line in told)
    told = json.loads((rendered / format / "export.json").read_text())["not_held"]
    assert not any("behind trees, people" in line or "`mask/`" in line for line in told)
    assert any("`depth/`" in line for line in told) == (format == "colmap")


@pytest.mark.parametrize("format", ["colmap", "transforms"])
def test_a_structure_out_of_view_has_no_points_and_a_recording_no_poses(tmp_path, format):
    sequence = make_sequence(tmp_path / "sequence", 2)
    behind = Pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3)) @ CAM_FROM_BODY
    (sequence.folder / "sequence.json").write_text(
        json.dumps({**sequence.info, "cam_from_body": behind.matrix.tolist()})
    )
    told = export(Sequence.load(sequence.folder), format, tmp_path / "away")
    assert any(line.startswith("Points: 0 of ") for line in told)
    if format == "colmap":
        assert pycolmap.Reconstruction(tmp_path / "away" / "sparse" / "0").num_points3D() == 0
    recorded = {**sequence.info, "initial_cam_from_world": np.eye(4).tolist()}
    (sequence.folder / "sequence.json").write_text(json.dumps(recorded))
    with pytest.raises(UserError, match="no ground truth"):
        export(Sequence.load(sequence.folder), format, tmp_path / "recorded")
    assert not (tmp_path / "recorded").exists()
