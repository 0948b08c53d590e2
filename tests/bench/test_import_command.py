"""`uavbench import`: images of one's own with known poses, made a sequence by a command."""

import numpy as np
import pytest
from click.testing import CliRunner

import uavbench as ub
from tests.bench.small_suites import own_images
from uavbench.bench.cli.main import main
from uavbench.bench.trial.check import TRIAL
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.trajectory_files.formats import write_tum


@pytest.fixture(scope="module")
def trial():
    return Sequence.load(TRIAL)


@pytest.fixture(scope="module")
def poses(trial):
    """True `world_from_cam` of the trial."""
    cameras = [trial.true_cam_from_world(frame).inverse() for frame in range(len(trial))]
    return Trajectory.from_poses(trial.stamps_ns.tolist(), cameras)


@pytest.fixture(scope="module")
def own(tmp_path_factory, poses):
    """Images, model, camera and poses as a user has them."""
    folder = tmp_path_factory.mktemp("own")
    own_images(folder)
    write_tum(poses, folder / "poses.tum")
    return folder


def by_command(own, out, poses, *more):
    given = {"images": own / "frames", "model": own / "model.obj", "camera": own / "camera.toml", "ground-truth": poses}
    words = [word for name, path in given.items() for word in (f"--{name}", path)]
    return CliRunner().invoke(main, [str(word) for word in ["import", *words, "--out", out, *more]])


def test_the_command_makes_the_same_sequence_as_python(own, tmp_path):
    files = {"model": own / "model.obj", "camera": own / "camera.toml", "ground_truth": own / "poses.tum"}
    made = ub.import_sequence(tmp_path / "box", own / "frames", **files)
    done = by_command(own, tmp_path / "command" / "box", own / "poses.tum")
    assert (done.exit_code, done.stdout) == (0, f"{tmp_path / 'command' / 'box'}\n")
    assert done.stderr == f"{len(made)} images at 15 Hz\n"
    for name in ("manifest.json", "sequence.json", "groundtruth.csv"):
        assert (tmp_path / "command" / "box" / name).read_bytes() == (made.folder / name).read_bytes()


def test_the_command_reads_the_camera_on_the_body(own, trial, tmp_path):
    mount = tmp_path / "mount.toml"
    mount.write_text(f"cam_from_body = {trial.cam_from_body.matrix.tolist()}\n")
    write_tum(trial.ground_truth, tmp_path / "body.tum")
    done = by_command(own, tmp_path / "box", tmp_path / "body.tum", "--cam-from-body", mount)
    assert done.exit_code == 0, done.output
    made = Sequence.load(tmp_path / "box")
    np.testing.assert_allclose(made.cam_from_body.matrix, trial.cam_from_body.matrix)
    np.testing.assert_allclose(made.true_cam_from_world(3).matrix, trial.true_cam_from_world(3).matrix, atol=1e-7)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("mount = [1.0]", "has the keys ['mount']; give cam_from_body alone, four rows of four"),
        ("cam_from_body = [[1.0, 0.0], [0.0, 1.0]]", "cam_from_body: expected shape (4, 4), got (2, 2)"),
        ("cam_from_body = 'front'", "cam_from_body: "),
    ],
)
def test_a_mount_that_is_none_is_told(own, tmp_path, text, told):
    (tmp_path / "mount.toml").write_text(text)
    done = by_command(own, tmp_path / "box", own / "poses.tum", "--cam-from-body", tmp_path / "mount.toml")
    assert done.exit_code == 2 and f"uavbench: {tmp_path / 'mount.toml'}: {told}" in done.stderr
    assert not (tmp_path / "box").exists()


def test_the_command_doubts_poses_beside_the_edges_and_refuses_what_python_does(own, poses, tmp_path):
    moved = Trajectory(poses.stamps_ns, poses.positions_m + np.array([0.1, 0.0, 0.0]), poses.quaternions_wxyz)
    write_tum(moved, tmp_path / "moved.tum")
    doubted = by_command(own, tmp_path / "box", tmp_path / "moved.tum")
    assert doubted.exit_code == 0 and doubted.stderr.startswith(f"doubt: {tmp_path / 'moved.tum'}: at these poses ")
    again = by_command(own, tmp_path / "box", own / "poses.tum")
    assert again.exit_code == 2 and f"uavbench: {tmp_path / 'box'}: exists, and is not overwritten" in again.stderr
