"""Initial poses and real images: files in, files out."""

import json
import struct

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit, pose_error
from uavbench.tracker.images.recorded_sequence import Files
from uavbench.tracker.images.track_images import in_order, track_images
from uavbench.tracker.images.video_images import VideoImages
from uavbench.tracker.initialization import (
    INITIALIZATIONS,
    CoarseGuess,
    Known,
    PickedPoints,
    pose_from_points,
    read_init,
)
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.registry import TRACKERS
from uavbench.trajectories.errors import UserError

BOX = box()
POSES = orbit(6, seed=7)
CAO = """V1
8
{points}
0
0
6
4 0 2 3 1
4 4 5 7 6
4 0 1 5 4
4 2 6 7 3
4 0 4 6 2
4 1 3 7 5
0
0
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Images, model, camera and initial pose of six frames."""
    folder = tmp_path_factory.mktemp("real")
    (folder / "images").mkdir()
    scene, rng = Scene([box_corners()], seed=7), np.random.default_rng(7)
    for i, pose in enumerate(POSES):
        cv2.imwrite(str(folder / f"images/{i:04d}.png"), scene.render(pose, noise_rng=rng))
    points = "\n".join(" ".join(map(str, p)) for p in box_corners().tolist())
    (folder / "box.cao").write_text(CAO.format(points=points))
    CAMERA.save(folder / "camera.toml")
    (folder / "init.toml").write_text(f"cam_from_model = {POSES[0].matrix.tolist()}\n")
    return folder


def test_five_points_give_the_pose():
    points = BOX.vertices[[0, 1, 4, 5, 7]]
    found = pose_from_points(points, CAMERA.project(POSES[0].transform(points)), CAMERA)
    assert pose_error(found, POSES[0])[0] < 1e-6


@pytest.mark.parametrize(
    ("points", "message"),
    [(np.zeros((3, 3)), "at least four"), (np.outer(np.arange(5.0), [1, 2, 3]), "one line")],
)
def test_points_that_fix_no_pose_are_refused(points, message):
    with pytest.raises(UserError, match=message):
        pose_from_points(points, np.zeros((len(points), 2)), CAMERA)


def test_every_initialization_comes_near_the_true_pose():
    image = Scene([box_corners()], seed=1).render(POSES[0])
    limits = {"known": 0.0, "picked-points": 0.05, "coarse-guess": 0.15}
    for name, kind in INITIALIZATIONS.items():
        poses = [kind().initial_pose(BOX, CAMERA, POSES[0], image, np.random.default_rng(3)) for _ in range(2)]
        assert pose_error(poses[0], POSES[0])[0] <= limits[name]
        np.testing.assert_array_equal(poses[0].matrix, poses[1].matrix)
    assert {Known, PickedPoints, CoarseGuess} == set(INITIALIZATIONS.values())


def test_init_toml_takes_a_matrix_or_points(tmp_path):
    path = tmp_path / "init.toml"
    path.write_text(f"cam_from_model = {POSES[0].matrix.tolist()}\n")
    np.testing.assert_allclose(read_init(path, CAMERA).matrix, POSES[0].matrix, atol=1e-12)
    corners = BOX.vertices[[0, 1, 4, 5, 7]]
    pixels = CAMERA.project(POSES[0].transform(corners))
    rows = [f"{{model_m = {p}, image_px = {q}}}" for p, q in zip(corners.tolist(), pixels.tolist(), strict=True)]
    path.write_text("points = [" + ", ".join(rows) + "]\n")
    assert pose_error(read_init(path, CAMERA), POSES[0])[0] < 1e-6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cam_from_model = [[1, 0, 0, 0]]", "cam_from_model"),
        ("pose = 1", "either cam_from_model or points"),
        ("points = [{model_m = [0, 0, 0]}]", "image_px"),
        ("points = [{model_m = [0, 0, 0], image_px = [1, 1]}]", "at least four"),
        ("points = ", "not a readable TOML"),
    ],
)
def test_a_bad_init_toml_is_named(tmp_path, text, message):
    path = tmp_path / "init.toml"
    path.write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        read_init(path, CAMERA)
    assert "init.toml" in str(caught.value)


@pytest.mark.parametrize(("shift_px", "good"), [(3.0, True), (60.0, False)])
def test_picked_points_that_no_pose_fits_are_named(tmp_path, shift_px, good):
    path = tmp_path / "init.toml"
    corners = BOX.vertices[[0, 1, 2, 4, 5, 7]]
    pixels = CAMERA.project(POSES[0].transform(corners))
    pixels[3, 0] += shift_px
    rows = [f"{{model_m = {p}, image_px = {q}}}" for p, q in zip(corners.tolist(), pixels.tolist(), strict=True)]
    path.write_text("points = [" + ", ".join(rows) + "]\n")
    if good:
        assert pose_error(read_init(path, CAMERA), POSES[0])[0] < 0.1
    else:
        with pytest.raises(UserError, match=r"init\.toml: points: .* px from its pixel; check which corner"):
            read_init(path, CAMERA)


@pytest.mark.parametrize(
    ("axes", "origin_m", "good"),
    [
        (np.eye(3), (0.0, 0.0, 0.0), True),
        (np.eye(3), (0.01, 0.0, 0.0), True),
        (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (0.0, 0.0, 0.0), False),
        (np.eye(3), (0.0, 0.0, 0.5), False),
    ],
)
def test_points_of_another_frame_than_the_models_are_named(tmp_path, axes, origin_m, good):
    """A pose fits them as well, and with it the model is drawn elsewhere."""
    path = tmp_path / "init.toml"
    corners = BOX.vertices[[0, 1, 2, 4, 5, 7]]
    pixels = CAMERA.project(POSES[0].transform(corners))
    rows = [
        f"{{model_m = {p}, image_px = {q}}}"
        for p, q in zip((corners @ axes.T + origin_m).tolist(), pixels.tolist(), strict=True)
    ]
    path.write_text("points = [" + ", ".join(rows) + "]\n")
    read_init(path, CAMERA)
    if good:
        read_init(path, CAMERA, BOX)
    else:
        with pytest.raises(UserError, match=r"init\.toml: points: points\[\d\] is .* m beside the model; .*glTF"):
            read_init(path, CAMERA, BOX)


GL = np.diag([1.0, -1.0, -1.0, 1.0])
MM = np.array([[1, 1, 1, 1000.0]] * 3 + [[1, 1, 1, 1]])


@pytest.mark.parametrize(
    ("pose", "seen"),
    [
        (np.linalg.inv(POSES[0].matrix), "not in the image"),
        (GL @ POSES[0].matrix, "not in the image"),
        (POSES[0].matrix * MM, "only .* px wide"),
    ],
)
def test_a_first_pose_that_does_not_show_the_model_is_named(files, tmp_path, pose, seen):
    path = tmp_path / "init.toml"
    path.write_text(f"cam_from_model = {pose.tolist()}\n")
    with pytest.raises(UserError, match=rf"init\.toml: at this pose the model is {seen}"):
        read_init(path, CAMERA, BOX)
    given = {"model": files / "box.cao", "camera": files / "camera.toml", "init": path}
    with pytest.raises(UserError, match=seen):
        track_images(TRACKERS["hold"](), files / "images", **given, out=tmp_path / "out")
    source = Files(
        images_path=str(files / "images"), model_file=str(files / "box.cao"),
        camera_file=str(files / "camera.toml"), init_file=str(path),
    )  # fmt: skip
    with pytest.raises(UserError, match=seen):
        source.find()


@pytest.mark.parametrize("rate_hz", [float("nan"), 0.0, -1.0, 1e12, 1e-12, float("inf")])
def test_a_rate_that_stamps_cannot_have_is_named(files, tmp_path, rate_hz):
    given = {"model": files / "box.cao", "camera": files / "camera.toml", "init": files / "init.toml"}
    with pytest.raises(UserError, match=r"Hz: images have 0\.001 to 1,000,000 Hz"):
        track_images(TRACKERS["hold"](), files / "images", **given, out=tmp_path / "out", rate_hz=rate_hz)


def test_a_folder_of_images_is_tracked(files, tmp_path):
    results = track_images(
        TRACKERS["robust"](),
        files / "images",
        model=files / "box.cao",
        camera=files / "camera.toml",
        init=files / "init.toml",
        out=tmp_path / "out",
        rate_hz=15,
    )
    assert results.ok.all()
    for found, true in zip(results.cam_from_world, POSES, strict=True):
        assert pose_error(found, true)[0] < 0.01
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "estimate_world_from_cam.tum", "frames.csv", "overlay.mp4", "record.json", "times.csv",
    }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert cv2.VideoCapture(str(tmp_path / "out/overlay.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 6


def video(files, folder, change=bytes, kind=("film.mp4", "mp4v")):
    """Results of `hold` on a video of the images at 10 Hz, its file changed; kind: its name and code."""
    path = folder / kind[0]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*kind[1]), 10.0, (CAMERA.width, CAMERA.height))
    for image in in_order(files / "images"):
        writer.write(cv2.imread(str(image)))
    writer.release()
    path.write_bytes(change(path.read_bytes()))
    given = {"model": files / "box.cao", "camera": files / "camera.toml", "init": files / "init.toml"}
    return track_images(TRACKERS["hold"](), path, **given, out=folder / "out")


def with_pauses(film, first=0.5, last=2):
    """The MP4 film of six images, the first four half as far apart and the last two twice as far, or as given."""
    data = bytearray(film)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):  # each holds the next
        at = data.index(name) - 4
        data[at : at + 4] = (int.from_bytes(data[at : at + 4]) + 8).to_bytes(4)
    at = data.index(b"stts") + 8
    assert data[at : at + 8] == struct.pack(">II", 1, 6)
    period = int.from_bytes(data[at + 8 : at + 12])
    data[at : at + 12] = struct.pack(">IIIII", 2, 4, int(first * period), 2, int(last * period))
    return bytes(data)


def test_the_images_of_a_video_have_its_times(files, tmp_path):
    results = video(files, tmp_path)
    assert results.stamps_ns.tolist() == [100_000_000 * frame for frame in range(6)]
    assert results.record["doubts"] == []


def test_a_video_of_a_variable_rate_has_its_own_times(files, tmp_path):
    times_s = video(files, tmp_path, with_pauses).stamps_ns * 1e-9
    np.testing.assert_allclose(times_s, [0.0, 0.05, 0.1, 0.15, 0.2, 0.4], atol=1e-6)


def test_a_video_of_which_not_all_can_be_read_is_told(files, tmp_path):
    def damaged(film):
        at = film.index(b"mdat")
        return film[: at + 2000] + bytes(len(film) // 2) + film[at + 2000 + len(film) // 2 :]

    results = video(files, tmp_path, damaged)
    assert len(results) < 6
    assert f"{len(results)} of 6 frames can be read" in results.record["doubts"][0]


def test_images_without_times_of_their_own_are_told(files, tmp_path):
    results = video(files, tmp_path, lambda film: with_pauses(film, first=0))
    assert (np.diff(results.stamps_ns) > 0).all()
    (doubt,) = results.record["doubts"]
    assert "film.mp4: frame 1 has no later time than the one before, 5 of 6 frames in all" in doubt


@pytest.mark.parametrize(("fps", "apart_ns"), [(100_000, 10_000), (1_000_000, 1000)])
def test_a_film_of_a_rate_that_no_camera_has_is_tracked_with_its_overlay(files, tmp_path, fps, apart_ns):
    def claims(film):
        at = film.index(b"strh") + 28
        return film[:at] + struct.pack("<II", 1, fps) + film[at + 8 :]

    results = video(files, tmp_path, claims, ("film.avi", "MJPG"))
    assert np.diff(results.stamps_ns).tolist() == [apart_ns] * 5
    assert cv2.VideoCapture(str(tmp_path / "out/overlay.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 6


def test_where_frames_are_missing_is_told(files, tmp_path):
    found = VideoImages(tmp_path / "film.mp4", CAMERA, 10.0, [0, 10**8, 13 * 10**8, 14 * 10**8])
    video(files, tmp_path)
    assert "4 of 6 frames can be read, none for 1.2 s after frame 1; it is damaged" in found.doubts[0]


class NeedsBody:
    """A tracker that cannot be started without a body, and reads no sensor of it."""

    def start(self, structure, camera, cam_from_world, rng, *, body):
        assert not body.sensors
        np.testing.assert_array_equal(body.cam_from_body.matrix, np.eye(4))
        return TRACKERS["hold"]().start(structure, camera, cam_from_world, rng)


def test_a_tracker_that_needs_a_body_has_one_on_real_images_too(files, tmp_path):
    paths = {"model": files / "box.cao", "camera": files / "camera.toml", "init": files / "init.toml"}
    assert track_images(NeedsBody(), files / "images", **paths, out=tmp_path / "out").ok.all()


def test_an_empty_folder_leaves_nothing_behind(files, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match="no images"):
        track_images(
            TRACKERS["hold"](),
            tmp_path / "empty",
            model=files / "box.cao",
            camera=files / "camera.toml",
            init=files / "init.toml",
            out=tmp_path / "out",
        )
    assert [p.name for p in tmp_path.iterdir()] == ["empty"]


def test_images_are_taken_in_the_order_of_their_numbers(tmp_path):
    names = ["a2.png", "a10.png", "b1_3.jpg", "b1_20.jpg", "b02_1.JPG"]
    for name in [*reversed(names), "notes.txt"]:
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names
    (tmp_path / "0007.png").touch()
    assert in_order(tmp_path)[0].name == "0007.png"


def test_names_with_other_digits_and_equal_numbers_have_one_order(tmp_path):
    names = ["a1.jpg", "a01.png", "a1.png", "a2.png", "\u00b21.png", "\u0663.png"]
    for name in reversed(names):
        (tmp_path / name).touch()
    assert [path.name for path in in_order(tmp_path)] == names


def held(files, images, out):
    given = {"model": files / "box.cao", "camera": files / "camera.toml", "init": files / "init.toml"}
    return track_images(TRACKERS["hold"](), images, **given, out=out, rate_hz=10.0)


class Blackens:
    """A tracker that writes into the images that it gets."""

    def start(self, structure, camera, cam_from_world, rng):
        self.pose = cam_from_world
        return self

    def track(self, image, stamp_ns):
        image[:] = 0
        return TrackResult(status="ok", cam_from_world=self.pose)


def test_the_overlay_shows_the_image_whatever_a_tracker_does_to_it(files, tmp_path):
    given = {"model": files / "box.cao", "camera": files / "camera.toml", "init": files / "init.toml"}
    track_images(Blackens(), files / "images", **given, out=tmp_path / "out")
    shown = cv2.VideoCapture(str(tmp_path / "out/overlay.mp4")).read()[1]
    assert shown.mean() == pytest.approx(cv2.imread(str(files / "images/0000.png")).mean(), abs=5)


def test_images_that_are_nearly_black_are_told(files, tmp_path):
    (tmp_path / "images").mkdir()
    for number, path in enumerate(in_order(files / "images")):
        image = cv2.imread(str(path))
        cv2.imwrite(str(tmp_path / "images" / path.name), (image > 99).astype(np.uint8) if number > 1 else image)
    (doubt,) = held(files, tmp_path / "images", tmp_path / "out").record["doubts"]
    assert doubt.startswith("images: 4 of 6 images have no grey level above 8 of 255, the first is frame 2: ")
    assert held(files, files / "images", tmp_path / "other").record["doubts"] == []


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("images/data.csv", "{ns},{ns}.png"),
        ("rgb.txt", "{s:.6f} rgb/{s:.6f}.png"),
        ("times.txt", "{s:.6e}"),
        ("timestamps.txt", "2011-09-26 13:02:25.{ns:09d}"),
    ],
)
def test_times_beside_images_are_told_unless_they_are_those_of_the_rate(files, tmp_path, name, line):
    (tmp_path / "images").mkdir()
    for path in in_order(files / "images"):
        (tmp_path / "images" / path.name).write_bytes(path.read_bytes())
    for rate_hz in (10, 30):
        lines = [line.format(s=k / rate_hz, ns=round(k * 1e9 / rate_hz)) for k in range(6)]
        (tmp_path / name).write_text("# a comment\n" + "\n".join(lines) + "\n")
        doubts = held(files, tmp_path / "images", tmp_path / "out").record["doubts"]
        if rate_hz == 10 and not line.startswith("2011"):
            assert doubts == []
        else:
            assert f"{name.rpartition('/')[2]}: seems to hold the times of the images, which are not read" in doubts[0]


def test_stamps_of_an_export_to_nerfstudio_are_told(files, tmp_path):
    """Its images are numbered without the gaps of dropped frames."""
    (tmp_path / "images").mkdir()
    for path in in_order(files / "images"):
        (tmp_path / "images" / path.name).write_bytes(path.read_bytes())
    for steps in (range(6), (0, 1, 3, 4, 5, 7), None):
        frames = [{"file_path": f"images/{k:06d}.png"} for k in range(6)]
        for frame, step in zip(frames, steps or (), strict=False):
            frame["stamp_ns"] = step * 10**8
        (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames[::-1]}))
        doubts = held(files, tmp_path / "images", tmp_path / "out").record["doubts"]
        assert len(doubts) == (steps is not None and steps[-1] > 5), doubts
        if doubts:
            assert "transforms.json: seems to hold the times of the images, which are not read" in doubts[0]


@pytest.mark.parametrize(
    ("head", "row"), [("stamp_ns,file", "{ns},{file}"), ("frame,stamp_ns,file", "{k},{ns},{file}")]
)
def test_stamps_of_frames_that_a_link_dropped_are_told(files, tmp_path, head, row):
    (tmp_path / "frames").mkdir()
    for path in in_order(files / "images"):
        (tmp_path / "frames" / path.name).write_bytes(path.read_bytes())
    for steps in (range(6), (0, 1, 3, 4, 5, 7)):
        rows = [row.format(k=k, ns=step * 10**8, file=f"frames/{k:06d}.png") for k, step in enumerate(steps)]
        (tmp_path / "frames.csv").write_text("\n".join([head, *rows]) + "\n")
        doubts = held(files, tmp_path / "frames", tmp_path / "out").record["doubts"]
        assert len(doubts) == (steps[-1] > 5), doubts
    assert "frames.csv: seems to hold the times of the images, which are not read" in doubts[0]
    (tmp_path / "frames.csv").write_text("frame,stamp_ns,status\n0,0,ok\n1,500000000,ok\n")  # of a tracker's results
    assert held(files, tmp_path / "frames", tmp_path / "out").record["doubts"] == []
