import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.hand_made import hand_made
from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit
from uavbench.scenes.dataset.ground_truth_files import GROUND_TRUTH_COLUMNS
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.dataset.structure_files import save_structure
from uavbench.scenes.dataset.verify import write_manifest
from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.results import Results
from uavbench.tracker.run import stride, track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose
from uavbench.trajectories.trajectory import Trajectory

MOUNT = Pose([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0.01, 0.0, -0.02])


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Twelve frames at 15 Hz around a box, as a sequence folder."""
    folder = tmp_path_factory.mktemp("sequence")
    poses = orbit(12)
    scene = Scene([box_corners()])
    rng = np.random.default_rng(5)
    (folder / "frames").mkdir()
    rows, ground_truth = [], []
    for i, pose in enumerate(poses):
        stamp = i * 66_666_667
        cv2.imwrite(str(folder / f"frames/{i:06d}.png"), scene.render(pose, noise_rng=rng))
        rows.append(f"{i},{stamp},frames/{i:06d}.png")
        body = pose.inverse() @ MOUNT
        numbers = [*body.translation.tolist(), *body.quaternion_wxyz.tolist(), *[0.0] * 9]
        ground_truth.append(f"{i},{stamp}," + ",".join(map(repr, numbers)))
    CAMERA.save(folder / "camera.toml")
    save_structure(box(), folder)
    (folder / "frames.csv").write_text("frame,stamp_ns,file\n" + "\n".join(rows) + "\n")
    (folder / "groundtruth.csv").write_text(",".join(GROUND_TRUTH_COLUMNS) + "\n" + "\n".join(ground_truth) + "\n")
    info = {"name": "orbit", "cam_from_body": MOUNT.matrix.tolist(), "content_hash": "f00"}
    (folder / "sequence.json").write_text(json.dumps(info))
    write_manifest(folder)
    return Sequence.load(folder)


def test_summary_tells_what_became_of_frames_without_a_pose():
    statuses = ["ok", "ambiguous", "not_initialized", "ambiguous", "lost"]
    rows = tuple(
        TrackResult(status=each, cam_from_world=Pose.identity() if each == "ok" else None) for each in statuses
    )
    results = Results({}, np.arange(5), np.arange(5), rows)
    assert results.summary == "1 of 5 frames with a pose, 2 ambiguous, 1 lost, 1 not initialized"
    assert Results({}, np.arange(1), np.arange(1), rows[:1]).summary == "1 of 1 frames with a pose"


def test_results_read_back_as_written(tmp_path):
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 6))
    rows = (
        TrackResult(status="ok", cam_from_world=Pose.exp(rng.normal(size=6)), covariance=A @ A.T, inliers=3),
        TrackResult(status="lost", stage_ms={"total": 1.25}, segments=7),
        TrackResult(status="ok", cam_from_world=Pose.exp(rng.normal(size=6)), stage_ms={"total": 0.1, "search": 0.3}),
    )
    results = Results({"cam_from_body": MOUNT.matrix.tolist()}, np.array([0, 2, 4]), np.array([5, 7, 10**18 + 1]), rows)
    results.save(tmp_path / "r")
    again = Results.load(tmp_path / "r")
    again.save(tmp_path / "s")
    assert again.stamps_ns.tolist() == results.stamps_ns.tolist()
    assert again.frames.tolist() == [0, 2, 4]
    assert again.rows[1] == rows[1]
    assert dict(again.rows[2].stage_ms) == {"total": 0.1, "search": 0.3}
    np.testing.assert_array_equal(again.rows[0].covariance, (A @ A.T + (A @ A.T).T) / 2)
    for a, b in zip(results.cam_from_world, again.cam_from_world, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-15)
    np.testing.assert_allclose(again.estimate.positions_m, results.estimate.positions_m, atol=1e-14)
    head, _, *rows = (tmp_path / "r/estimate_world_from_body.tum").read_text().splitlines()
    assert head == "# frame: world_from_body"
    assert len(rows) == 2
    said = [json.loads((tmp_path / name / "record.json").read_text()) for name in ("r", "s")]
    assert said[0]["files"].keys() == said[1]["files"].keys()  # the digests are of poses that were rounded once more
    assert [{k: v for k, v in each.items() if k not in ("files", "made_by")} for each in said] == [
        {"cam_from_body": MOUNT.matrix.tolist()}
    ] * 2


def test_a_bad_row_is_named(tmp_path):
    results = Results(
        {"cam_from_body": np.eye(4).tolist()}, np.array([0]), np.array([0]), (TrackResult(status="lost"),)
    )
    results.save(tmp_path / "r")
    table = hand_made(tmp_path / "r") / "frames.csv"
    table.write_text(table.read_text().replace("lost", "missing"))
    with pytest.raises(UserError, match=r"frames\.csv: line 2"):
        Results.load(tmp_path / "r")


@pytest.mark.parametrize("kind", sorted(TRACKERS))
def test_a_run_is_the_same_on_every_run(sequence, kind, tmp_path):
    for name in ("a", "b"):
        track_sequence(TRACKERS[kind](), sequence, rate_hz=15, seed=0).save(tmp_path / name)
    for file in ("frames.csv", "estimate_world_from_body.tum", "record.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_lsd_follows_the_box(sequence):
    seen = []
    results = track_sequence(TRACKERS["lsd"](), sequence, rate_hz=15, seed=0, on_frame=lambda f, r: seen.append(f))
    assert results.ok.all()
    assert seen == list(range(12))
    error = np.linalg.norm(results.estimate.positions_m - sequence.ground_truth.positions_m, axis=1)
    assert error.max() < 0.03
    assert results.record["tracker"]["kind"] == "lsd"
    assert all(row.segments > 0 and row.stage_ms["total"] > 0 for row in results.rows)


def test_every_kth_frame_is_taken(sequence):
    assert track_sequence(Hold(), sequence, rate_hz=5, seed=0).frames.tolist() == [0, 3, 6, 9]
    assert track_sequence(Hold(), sequence, rate_hz=15 / 11, seed=0).frames.tolist() == [0, 11]
    for rate_hz, told in (
        (30, "rate_hz: 30 Hz is more than the 15 Hz of sequence orbit"),
        (0, "rate_hz: 0 Hz: the rate must be positive"),
    ):
        with pytest.raises(UserError, match=told):
            track_sequence(Hold(), sequence, rate_hz=rate_hz, seed=0)


def test_the_rate_of_a_sequence_is_the_one_of_its_record_whatever_its_jitter(sequence):
    late = np.resize([0, 10_000_000, 30_000_000], 12)
    jittered = replace(sequence, stamps_ns=sequence.stamps_ns + late, info={**sequence.info, "rate_hz": 15.0})
    assert abs(1e9 / np.median(np.diff(jittered.stamps_ns)) / 15 - 1) > 0.1
    assert [stride(jittered, rate_hz) for rate_hz in (15, 7.5, 5, 3)] == [1, 2, 3, 5]


def test_the_rate_of_a_sequence_is_the_one_of_its_record_whatever_the_link_lost(sequence):
    """That of a twin of every second frame is half of it."""
    numbers, info = np.arange(0, 60, 2), {**sequence.info, "rate_hz": 15.0}
    lossy, twin = (replace(sequence, stamps_ns=66_666_667 * k, info=info) for k in (np.sort([*numbers, 7]), numbers))
    assert [stride(lossy, rate_hz) for rate_hz in (15, 7.5, 5)] == [1, 2, 3]
    assert [stride(twin, rate_hz) for rate_hz in (7.5, 3.75)] == [1, 2]
    with pytest.raises(UserError, match=r"15 Hz is more than the 7.5 Hz"):
        stride(twin, 15.0)


def test_hold_stays_at_the_first_pose(sequence):
    results = track_sequence(Hold(), sequence, rate_hz=15, seed=0)
    assert isinstance(results.estimate, Trajectory)
    np.testing.assert_allclose(results.estimate.positions_m, sequence.ground_truth.positions_m[[0] * 12], atol=1e-12)


class Crashing:
    """A tracker that raises on its third frame."""

    def start(self, structure, camera, cam_from_world, rng):
        self.frame = 0
        return self

    def track(self, image, stamp_ns):
        self.frame += 1
        if self.frame == 3:
            raise ZeroDivisionError("no edges")
        return TrackResult(status="ok", cam_from_world=Pose.identity())


def test_a_trackers_exception_is_a_lost_frame_with_its_name(sequence):
    results = track_sequence(Crashing(), sequence, rate_hz=15, seed=0)
    assert results.ok.tolist() == [True, True, False] + [True] * 9
    (error,) = results.record["errors"]
    assert error.startswith("frame 2: ZeroDivisionError: no edges (")
    assert "test_results.py:" in error


def test_a_truncated_image_is_the_users_mistake(sequence, tmp_path):
    import shutil

    shutil.copytree(sequence.folder, tmp_path / "broken")
    path: Path = tmp_path / "broken/frames/000003.png"
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(UserError, match="000003"):
        track_sequence(Hold(), Sequence.load(tmp_path / "broken"), rate_hz=15, seed=0)
