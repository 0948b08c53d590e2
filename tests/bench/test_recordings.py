"""Recordings of real images: no ground truth is made up, and none is needed for the rest of the job."""

import json
import shutil

import cv2
import numpy as np
import pytest

from tests.bench.conftest import in_one_process
from tests.bench.small_suites import OWN_IMAGES, own_images
from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, orbit
from uavbench.bench.config.suite import load_suite
from uavbench.bench.trial.check import TRIAL
from uavbench.reports.recorded_score import RecordedRun, edges_met, longest_gap_s, score_recorded
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.scenes.model_files.cao.writing import write_cao
from uavbench.tracker.images.recorded_sequence import VISP_CUBE, Files, RecordingSpec, VispCube, record
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.results import Results
from uavbench.tracker.run import track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose, rotation_log

SUITE = OWN_IMAGES + 'lsd = { kind = "lsd" }\n'


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """The bundled trial's images, model and camera as a user has them, with an initial pose."""
    folder = tmp_path_factory.mktemp("own")
    own_images(folder)
    (folder / "own.toml").write_text(SUITE)
    return folder


@pytest.fixture(scope="module")
def sequence(own, tmp_path_factory):
    names = {"images_path": "frames", "model_file": "model.obj", "camera_file": "camera.toml", "init_file": "init.toml"}
    source = Files(**{key: str(own / name) for key, name in names.items()})
    folder = tmp_path_factory.mktemp("recorded") / "own"
    record(RecordingSpec(name="own", seed=0, source=source, rate_hz=15.0), folder, content_hash="abc")
    return Sequence.load(folder)


def test_a_recording_is_a_sequence_without_truth(sequence):
    trial = Sequence.load(TRIAL)
    assert len(sequence) == len(trial)
    assert np.array_equal(sequence.image(3), trial.image(3))
    assert np.allclose(np.diff(sequence.stamps_ns), 1e9 / 15, atol=1)
    assert np.allclose(sequence.initial_cam_from_world.matrix, trial.true_cam_from_world(0).matrix)
    with pytest.raises(UserError, match="no ground truth"):
        sequence.true_cam_from_world(0)


def test_edges_met_tell_a_good_pose_from_one_gone_astray(tmp_path):
    (tmp_path / "images").mkdir()
    pose, scene = orbit(1, seed=7)[0], Scene([box_corners()], seed=7)
    cv2.imwrite(str(tmp_path / "images/0.png"), scene.render(pose, noise_rng=np.random.default_rng(7)))
    write_cao(box(), tmp_path / "box.cao")
    CAMERA.save(tmp_path / "camera.toml")
    (tmp_path / "init.toml").write_text(f"cam_from_model = {pose.matrix.tolist()}\n")
    files = (str(tmp_path / name) for name in ("images", "box.cao", "camera.toml", "init.toml"))
    source = Files(**dict(zip(("images_path", "model_file", "camera_file", "init_file"), files, strict=True)))
    record(RecordingSpec(name="box", seed=0, source=source), tmp_path / "box", content_hash="abc")
    sequence = Sequence.load(tmp_path / "box")
    astray = [Pose.exp(np.array([x, y, 0, 0, 0, 0])) @ pose for x, y in ((0.03, 0), (0, 0.03), (-0.05, 0.02))]
    assert edges_met(sequence, 0, pose) > 1.2 * max(edges_met(sequence, 0, wrong) for wrong in astray)
    behind = Pose.exp(np.array([0, 0, -50.0, 0, 0, 0])) @ pose
    assert edges_met(sequence, 0, behind) == 0.0


def test_lost_and_missing_frames_are_counted(sequence):
    results = track_sequence(TRACKERS["hold"](), sequence, rate_hz=15.0, seed=0)
    rows = list(results.rows)
    rows[2:5] = [TrackResult(status="lost")] * 3
    lost = Results(results.record, results.frames, results.stamps_ns, tuple(rows))
    found = score_recorded(sequence, lost)
    assert (found.status, found.coverage) == ("lost", pytest.approx(0.7))
    assert found.longest_gap_s == pytest.approx(0.2, abs=1e-6)
    assert np.isnan(RecordedRun(sequence, lost).edges_met).sum() == 3
    short = Results(results.record, results.frames[:4], results.stamps_ns[:4], tuple(results.rows[:4]))
    assert score_recorded(sequence, short).status == "crashed"
    assert score_recorded(sequence, short).coverage == pytest.approx(0.4)


def test_a_gap_lasts_until_the_next_pose_or_the_end():
    t = np.arange(6.0)
    assert longest_gap_s(t, np.array([1, 0, 0, 1, 0, 1], dtype=bool)) == 2.0
    assert longest_gap_s(t, np.array([1, 1, 0, 0, 0, 0], dtype=bool)) == 3.0
    assert longest_gap_s(t, np.ones(6, dtype=bool)) == 0.0


def test_the_report_of_a_recording_has_no_error_in_it(own, tmp_path):
    done = in_one_process("run", own / "own.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    scores = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert {score["label"] for score in scores["scores"]} == {"hold", "lsd"}
    assert scores["ground_truth"] is None
    assert not any({"ate", "rpe", "tracking"} & set(score) for score in scores["scores"])
    page = (tmp_path / "out" / "index.html").read_text()
    assert "no ground truth" in page
    for name in ("lsd", "hold"):
        assert (tmp_path / "out" / "figures" / f"overlay_own-s0_{name}@15hz.webp").stat().st_size > 1000
    again = in_one_process("run", own / "own.toml", "--out", tmp_path / "out")
    assert "0 jobs done" in again.stderr


def test_a_recording_that_cannot_be_imported_is_named_in_the_report_of_the_others(own, tmp_path):
    shutil.copytree(own, tmp_path / "own")
    (tmp_path / "own" / "broken.toml").write_text("cam_from_model = 3\n")
    broken = SUITE[SUITE.index("[rec") : SUITE.index("[trackers]")].replace("init.toml", "broken.toml")
    broken = broken.replace("recordings.own", "recordings.broken")
    (tmp_path / "own" / "two.toml").write_text(SUITE.replace("[trackers]", f"{broken}[trackers]"))
    done = in_one_process("run", tmp_path / "own" / "two.toml", "--out", tmp_path / "out")
    assert done.exit_code == 2 and "FAILED render broken-s0" in done.stderr
    assert "FAILED: no run on broken-s0" in done.stdout
    (reason,) = json.loads((tmp_path / "out" / "scores.json").read_text())["unrendered"].values()
    page = (tmp_path / "out" / "index.html").read_text()
    assert "broken-s0</strong>" in page and "broken.toml" in page and "broken.toml" in reason


def test_rendered_and_recorded_sequences_do_not_mix(own):
    box = 'sequences.box = { structure = { kind = "box" }, environment = { kind = "indoor" }'
    both = SUITE.replace("[recordings", box + ', flight = { path = { kind = "hover" } } }\n[recordings', 1)
    for name, text in (("both", both), ("none", SUITE[: SUITE.index("[rec")] + SUITE[SUITE.index("[trackers") :])):
        (own / f"{name}.toml").write_text(text)
        with pytest.raises(UserError, match="either `sequences`, which are rendered, or `recordings`"):
            load_suite(own / f"{name}.toml")


def test_the_cube_of_visp_is_found_or_named(tmp_path):
    """A folder laid out as Debian's package lays it out."""
    with pytest.raises(UserError, match=r"apt-get install visp-images-data"):
        VispCube(str(tmp_path)).find()
    trial = Sequence.load(TRIAL)
    (tmp_path / VISP_CUBE).mkdir(parents=True)
    shutil.copy(TRIAL / "frames" / "000000.png", tmp_path / VISP_CUBE / "image0000.png")
    write_cao(trial.structure, tmp_path / "mbt/cube.cao")
    pose = trial.true_cam_from_world(0)
    numbers = [*pose.translation, *rotation_log(pose.rotation)]
    (tmp_path / "mbt/cube.0.pos").write_text("\n".join(map(repr, map(float, numbers))))
    found = VispCube(str(tmp_path)).find()
    assert np.allclose(found.initial_cam_from_world.matrix, pose.matrix)
    assert len(found.structure.edges) == len(trial.structure.edges)
    (tmp_path / "mbt/cube.0.pos").write_text("1 2 3")
    with pytest.raises(UserError, match=r"cube.0.pos.*3 numbers"):
        VispCube(str(tmp_path)).find()
