"""Images of one's own with known poses: sequences with ground truth, by Python and in suites."""

import json
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest

import uavbench as ub
from tests.bench.conftest import in_one_process
from tests.bench.small_suites import own_images
from uavbench.bench.config.suite import load_suite
from uavbench.bench.own_images.true_poses import rate_of
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.ground_truth_files import states_of
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.verify import verify
from uavbench.scenes.exports.registry import export
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_kitti, write_tum

OPENGL = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
SUITE = """
title = "Our own images"
rates_hz = [15.0]
[recordings.own]
rate_hz = 15.0
ground_truth_file = "poses.tum"
source = { kind = "files", images_path = "frames", model_file = "model.obj", camera_file = "camera.toml" }
[trackers]
hold = { kind = "hold" }
"""


@pytest.fixture(scope="module")
def trial():
    return Sequence.load(TRIAL)


@pytest.fixture(scope="module")
def poses(trial):
    """True `world_from_cam` of the trial."""
    return of_cameras(trial, lambda pose: pose)


def of_cameras(trial, change):
    cameras = [change(trial.true_cam_from_world(frame).inverse()) for frame in range(len(trial))]
    return Trajectory.from_poses(trial.stamps_ns.tolist(), cameras)


@pytest.fixture(scope="module")
def own(tmp_path_factory, poses):
    """Images, model, camera and poses as a user has them."""
    folder = tmp_path_factory.mktemp("own")
    own_images(folder)
    write_tum(poses, folder / "poses.tum")
    (folder / "own.toml").write_text(SUITE)
    return folder


@pytest.fixture
def imported(own, tmp_path):
    """Imports poses with the images; a doubt is an error here."""

    def make(ground_truth, images=None, **more):
        given = {"model": own / "model.obj", "camera": own / "camera.toml", "ground_truth": ground_truth, **more}
        return ub.import_sequence(tmp_path / "box", images or own / "frames", **given)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield make


def test_an_imported_sequence_is_one_with_ground_truth(imported, trial, poses):
    made = imported(poses)
    assert verify(made.folder).ok
    assert (made.name, made.info["rate_hz"], made.recorded, made.own_images) == ("box", 15.0, False, True)
    assert made.info["ground_truth"]["stamps"] == "the stamps of the poses"
    assert np.array_equal(made.stamps_ns, trial.stamps_ns)
    assert np.array_equal(made.image(3), trial.image(3))
    for frame in range(len(trial)):
        assert np.allclose(made[frame].cam_from_world.matrix, trial[frame].cam_from_world.matrix, atol=1e-12)
    again = ub.open_sequence(made.folder)
    assert again.content_hash == made.content_hash
    with pytest.raises(UserError, match="exists, and is not overwritten; name a new folder"):
        imported(poses)


def test_exports_claim_nothing_of_a_simulation(imported, poses, tmp_path):
    made = imported(poses)
    for form in ("tum", "euroc"):
        export(made, form, tmp_path / form)
    about = json.loads((tmp_path / "tum" / "croissant.json").read_text())
    assert about["rai:dataCollectionType"] == ["Others"]
    assert "rai:dataReleaseMaintenancePlan" not in about, "no config reproduces the images"
    readme = (tmp_path / "euroc" / "README.md").read_text()
    assert "at each image" in readme and "100 Hz" not in readme
    states = np.loadtxt(tmp_path / "euroc/mav0/state_groundtruth_estimate0/data.csv", delimiter=",")
    assert np.allclose(states[:, 1:4], poses.positions_m)
    assert ub.evaluate(tmp_path / "tum", made.folder / "groundtruth.csv", mount=made.folder).coverage == 1


def test_poses_of_a_body_have_its_camera(imported, trial):
    made = imported(trial.ground_truth, cam_from_body=trial.cam_from_body.matrix)
    assert np.allclose(made.ground_truth.positions_m, trial.ground_truth.positions_m)
    assert np.allclose(made.cam_from_body.matrix, trial.cam_from_body.matrix)


def test_a_file_says_what_its_poses_are_of(imported, own, trial, poses, tmp_path):
    """cam_from_world is inverted; world_from_cam becomes that of the body where the mount is given."""
    write_tum(of_cameras(trial, Pose.inverse), tmp_path / "cam_from_world.tum")
    said = tmp_path / "said.tum"
    said.write_text("# frame: cam_from_world\n" + (tmp_path / "cam_from_world.tum").read_text())
    assert np.allclose(imported(said).ground_truth.positions_m, poses.positions_m)
    shutil.rmtree(tmp_path / "box")
    said.write_text("# frame: world_from_cam\n" + (own / "poses.tum").read_text())
    made = imported(said, cam_from_body=trial.cam_from_body)
    assert np.allclose(made.ground_truth.positions_m, trial.ground_truth.positions_m)
    shutil.rmtree(tmp_path / "box")
    assert np.allclose(imported(TRIAL / "groundtruth.csv").cam_from_body.matrix, trial.cam_from_body.matrix)
    shutil.copy(TRIAL / "groundtruth.csv", tmp_path)
    shutil.rmtree(tmp_path / "box")
    with pytest.raises(UserError, match=r"has poses of the body \(world_from_body\).*give cam_from_body"):
        imported(tmp_path / "groundtruth.csv")


def in_mm(pose):
    return Pose(pose.rotation, 1000 * pose.translation)


def in_km(pose):
    return Pose(pose.rotation, pose.translation / 1000)


def w_first(pose):
    return Pose.from_quaternion(pose.quaternion_wxyz[[3, 0, 1, 2]], pose.translation)


def w_last(pose):
    return Pose.from_quaternion(pose.quaternion_wxyz[[1, 2, 3, 0]], pose.translation)


@pytest.mark.parametrize(("change", "told"), [
    (Pose.inverse, "at their inverses"),
    (lambda pose: pose @ OPENGL, "with a camera as in OpenGL and Blender"),
    (lambda pose: (pose @ OPENGL).inverse(), "at their inverses, with a camera as in OpenGL"),
    (in_mm, "with positions in millimetres"),
    (in_km, "with a model in metres, as the poses, in place of millimetres"),
    (w_first, "with w first in the quaternions"),
])  # fmt: skip
def test_poses_in_another_convention_are_told_by_it(imported, trial, tmp_path, change, told):
    with pytest.raises(
        UserError, match=rf"the ground truth: at these poses .* 0 of 10 images, and {told} .*80 % of its edges"
    ):
        imported(of_cameras(trial, change))
    assert not (tmp_path / "box").exists()


def test_the_body_is_told_where_its_camera_is_missing_or_inverted(imported, trial):
    with pytest.raises(UserError, match=r"as poses of a body .*, whose cam_from_body is missing 80 %"):
        imported(trial.ground_truth)
    with pytest.raises(UserError, match=r"with the inverse of cam_from_body 80 %"):
        imported(trial.ground_truth, cam_from_body=trial.cam_from_body.inverse())


def test_poses_of_elsewhere_are_told(imported, trial):
    with pytest.raises(
        UserError,
        match=r"the model is in 0 of 10 images; give world_from_cam .* origin and axes of the world those of the model",
    ):
        imported(of_cameras(trial, lambda pose: Pose(pose.rotation, pose.translation - [0.0, 0.0, 40.0])))
    away = trial.ground_truth.stamps_ns[3]
    late = of_cameras(trial, lambda pose: pose)
    places = np.where(late.stamps_ns[:, None] < away, late.positions_m - [0, 0, 40.0], late.positions_m)
    with pytest.raises(
        UserError, match=r"is in 7 of 10 images, but not in 000000.png; leave out the images before 000003.png"
    ):
        imported(replace(late, positions_m=places))


@pytest.mark.parametrize("change", [
    lambda pose: Pose.exp(np.array([0, 0, 0.3, 0, 0, 0])) @ pose,
    lambda pose: pose @ Pose(np.eye(3), [0.03, 0.0, 0.0]),
    lambda pose: pose @ Pose.exp(np.array([0, 0, 0, 0, 0.03, 0])),
])  # fmt: skip
def test_poses_beside_the_edges_of_the_images_are_doubted(imported, trial, change):
    """As by markers beside the camera: where edges agree by chance, as many do with the camera turned a little."""
    told = (
        r"\d+ % of the model's edges lie on edges of the images, and \d+ % with the camera turned by 2 % .*are stamps"
    )
    with pytest.raises(UserWarning, match=told):
        imported(of_cameras(trial, change))


@pytest.mark.parametrize(("times_s", "told"), [
    (np.arange(10), "poses are a second apart, and so are the images: are its stamps numbers of frames"),
    (np.arange(10) / 0.015, "poses are 67 s apart, and so are the images: are its stamps in another unit"),
    (np.arange(10) * 1e-5, "poses are 1e-05 s apart, and so are the images: are its stamps in another unit"),
])  # fmt: skip
def test_stamps_that_are_no_times_are_doubted(imported, poses, tmp_path, times_s, told):
    stamped = replace(poses, stamps_ns=np.rint(times_s * 1e9).astype(np.int64))
    with pytest.raises(UserWarning, match=told):
        imported(stamped)
    shutil.rmtree(tmp_path / "box")
    assert imported(stamped, rate_hz=rate_of(stamped.stamps_ns)).info["doubts"] == []


def test_images_in_order_whose_times_are_others_are_doubted(imported, own, poses, tmp_path):
    shutil.copytree(own / "frames", tmp_path / "images")
    times = tmp_path / "times.txt"
    times.write_text("".join(f"{1e3 + ns / 1e9:.6f}\n" for ns in poses.stamps_ns))
    assert imported(poses, tmp_path / "images").info["doubts"] == []
    shutil.rmtree(tmp_path / "box")
    times.write_text("".join(f"{2 * ns / 1e9:.6f}\n" for ns in poses.stamps_ns))
    with pytest.raises(UserWarning, match=r"times.txt: seems to hold other times of the images than the ground truth"):
        imported(poses, tmp_path / "images")
    times.unlink()
    shutil.rmtree(tmp_path / "box")
    (tmp_path / "images" / "000009.png").rename(tmp_path / "images" / "000012.png")
    with pytest.raises(UserWarning, match=r"after 000008.png comes 000012.png, .* 0.066 s apart .* 0.264 s are exp"):
        imported(poses, tmp_path / "images")
    shutil.rmtree(tmp_path / "box")
    late = np.r_[poses.stamps_ns[:9], poses.stamps_ns[9] + 3 * 66_666_667]
    assert imported(replace(poses, stamps_ns=late), tmp_path / "images").info["doubts"] == []
    shutil.rmtree(tmp_path / "box")
    with pytest.raises(UserWarning, match=r"000008.png is given after 000009.png: images are taken in the order in"):
        imported(poses, [own / f"frames/{k:06d}.png" for k in reversed(range(10))])
    shutil.rmtree(tmp_path / "box")
    twice = [own / f"frames/{k:06d}.png" for k in (*range(9), 8)]
    with pytest.raises(UserWarning, match=r"after 000008.png comes 000008.png, .* where 0 s"):
        imported(poses, twice)


def test_poses_that_fit_better_in_another_convention_are_doubted_by_it(imported, trial):
    with pytest.raises(UserWarning, match=r"10 % of the model's edges .*, and with w last in the quaternions 80 %"):
        imported(of_cameras(trial, w_last))


def test_poses_are_paired_by_the_times_in_names(imported, own, trial, poses, tmp_path):
    """Motion capture at another rate and of its own times, and images named by theirs."""
    start_ns = 1_700_000_000_000_000_000
    (tmp_path / "images").mkdir()
    for stamp_ns, file in zip(trial.stamps_ns.tolist(), trial.files, strict=True):
        shutil.copy(TRIAL / file, tmp_path / "images" / f"{start_ns + stamp_ns}.png")
    dense = np.arange(-10_000_000, 700_000_000, 10_000_000)
    flown = [np.interp(dense, trial.stamps_ns, poses.positions_m[:, k]) for k in range(3)]
    nearest = np.abs(dense[:, None] - trial.stamps_ns).argmin(axis=1)
    capture = Trajectory(dense + start_ns, np.column_stack(flown), poses.quaternions_wxyz[nearest])
    made = imported(capture, tmp_path / "images")
    assert made.stamps_ns[1] == start_ns + trial.stamps_ns[1]
    assert np.allclose(made.ground_truth.positions_m, poses.positions_m, atol=2e-4)
    assert made.info["ground_truth"]["interpolated"] == 6
    shutil.rmtree(tmp_path / "box")
    with pytest.raises(
        UserError, match=r"has no pose for 1700000000400000000.png at 1700000000.4\d* s, by the names of"
    ):
        imported(capture.select(slice(0, 40)), tmp_path / "images")
    with pytest.raises(UserError, match=r"\(10 of 10 images\); leave these images out, give a pose for each"):
        imported(poses, tmp_path / "images")


def test_counts_and_rates_that_do_not_fit_are_told(imported, own, poses, tmp_path):
    with pytest.raises(UserError, match="has 8 poses for 10 images without times; give the rate of the images"):
        imported(poses.select(slice(0, 8)))
    with pytest.raises(UserError, match=r"has no pose for 000008.png at 0.533333 s, by their rate.*\(2 of 10 images\)"):
        imported(poses.select(slice(0, 8)), rate_hz=15.0)
    with pytest.raises(UserError, match="there are 15 images a second, and rate_hz is 30; write rate_hz = 15"):
        imported(poses, rate_hz=30.0)
    write_kitti(poses, tmp_path / "poses.txt")
    with pytest.raises(UserError, match="has 10 poses without times for 10 images without times; give the rate"):
        imported(tmp_path / "poses.txt")
    assert np.allclose(np.diff(imported(tmp_path / "poses.txt", rate_hz=15.0).stamps_ns), 1e9 / 15, atol=1)
    shutil.rmtree(tmp_path / "box")
    write_kitti(poses.select(slice(0, 9)), tmp_path / "fewer.txt")
    with pytest.raises(UserError, match="has 9 poses without times for 10 images; give one for each image, in order"):
        imported(tmp_path / "fewer.txt", rate_hz=15.0)


def test_quaternions_that_are_no_rotations_are_told(imported, poses):
    rows = np.column_stack([poses.stamps_ns / 1e9, poses.positions_m, 1.1 * poses.quaternions_wxyz])
    with pytest.raises(UserError, match="the ground truth: row 0: quaternion is not finite or not of unit norm"):
        imported(rows)


@pytest.mark.parametrize(("given", "told"), [
    ({"cam_from_body": np.eye(3)}, "cam_from_body: .*give a Pose or a homogeneous matrix"),
    ({"rate_hz": 0.0}, "rate_hz = 0.0: must be a positive number"),
    ({"camera": 3}, "camera takes a Camera"),
    ({"images": ["none.png"] * 10}, "none.png: no such file"),
    ({"images": "nowhere"}, "nowhere: not a readable folder"),
])  # fmt: skip
def test_what_is_no_input_is_told(imported, poses, given, told):
    with pytest.raises(UserError, match=told):
        imported(poses, **given)


def test_motion_is_that_of_differences():
    t = np.array([0.0, 0.1, 0.25, 0.3, 0.4])
    turned = [Pose.exp(np.array([0, 0, 0, 0, 0, 0.5 * s])) for s in t]
    poses = [Pose(pose.rotation, [2 * s, s * s, 1.0]) for pose, s in zip(turned, t, strict=True)]
    states = states_of(Trajectory.from_poses(np.rint(1e9 * t).astype(int).tolist(), poses))
    assert np.allclose(states[:, 7], 2.0)
    assert np.allclose(states[1:-1, 8], 2 * t[1:-1])
    assert np.allclose(states[:, 10:13], [0, 0, 0.5])
    assert np.allclose(states[2, 13:], [0, 2, 0])
    assert not states_of(Trajectory.from_poses([5], poses[:1]))[:, 7:].any()


def test_the_rate_is_that_without_missing_images():
    assert rate_of(np.array([0, 100, 200, 500, 600]) * 10**6) == 10.0
    with pytest.raises(UserError, match="one image has no rate"):
        rate_of(np.array([0]))


def test_a_suite_scores_recordings_with_ground_truth(own, tmp_path, trial):
    done = in_one_process("run", own / "own.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    (score,) = json.loads((tmp_path / "out" / "scores.json").read_text())["scores"]
    held = trial.ground_truth.positions_m
    expected = np.sqrt((np.linalg.norm(held - held[0], axis=1) ** 2).mean())
    assert score["ate"]["none"]["translation_m"]["rmse"] == pytest.approx(expected, rel=1e-6)
    assert "0 jobs done" in in_one_process("run", own / "own.toml", "--out", tmp_path / "out").stderr


@pytest.mark.parametrize(("old", "new", "told"), [
    ('ground_truth_file = "poses.tum"\n', "", "recordings.own: source.init_file: this key is missing, and so is"),
    ("camera.toml", 'camera.toml", init_file = "init.toml', "ground_truth_file tells the initial pose, too"),
    ("rate_hz = 15.0\nground", "cam_from_body = [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\nground",
     "recordings.own: cam_from_body: not a rigid transform"),
    ('ground_truth_file = "poses.tum"', "cam_from_body = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
     "recordings.own: source.init_file"),
    ("[trackers]", '[recordings.more]\nsource = { kind = "visp-cube" }\n[trackers]',
     "recordings.more: has no ground_truth_file, as others have; put those without into a suite of their own"),
])  # fmt: skip
def test_a_suite_whose_ground_truth_is_not_whole_is_refused(own, tmp_path, old, new, told):
    path = own / f"{tmp_path.name}.toml"
    assert old in SUITE
    path.write_text(SUITE.replace(old, new, 1))
    with pytest.raises(UserError, match=told):
        load_suite(path)
