"""Trackers of others that go wrong: each is told by a name, with the place in its own code."""

import contextlib
import importlib
import shutil
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from click.testing import CliRunner

from uavbench.bench.cli.main import main
from uavbench.bench.config.suite import load_tracker
from uavbench.bench.inputs.worker_plugins import Plugins
from uavbench.bench.runner.commands import count_failed_trackers
from uavbench.bench.runner.graph import Job, JobFaultError, Outcome, run_job
from uavbench.bench.runner.tasks import Track
from uavbench.bench.runner.written_files import Made, Place
from uavbench.bench.trial.check import TRIAL, check
from uavbench.reports.protocols.restarting import run_from_anchors
from uavbench.scenes.dataset.sequence import Sequence
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.run import begin, track_frame, track_sequence
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose

MODULE = """
import sys
from dataclasses import dataclass
import numpy as np
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose

@dataclass(frozen=True)
class Mine:
    def start(self, structure, camera, cam_from_world, rng):
        {start}
        return Run(cam_from_world)

def helper(image):
    return np.linalg.inv(np.zeros((2, 2)))  # raises deep in numpy

class Run:
    def __init__(self, pose):
        self.pose, self.n = pose, -1
    def track(self, image, stamp_ns):
        self.n += 1
        ok = TrackResult(status="ok", cam_from_world=self.pose)
        {track}
        return ok
"""
LINE = {"start": 11, "helper": 15, "track": 23}


@pytest.fixture
def mine(tmp_path, monkeypatch):
    def make(track="pass", start="pass"):
        (tmp_path / "my_tracker.py").write_text(MODULE.format(track=track, start=start))
        monkeypatch.syspath_prepend(tmp_path)
        sys.modules.pop("my_tracker", None)
        importlib.invalidate_caches()
        return importlib.import_module("my_tracker").Mine()

    yield make
    sys.modules.pop("my_tracker", None)


@pytest.fixture(scope="module")
def sequence():
    return Sequence.load(TRIAL)


def errors(tracker, sequence):
    return track_sequence(tracker, sequence, rate_hz=15.0, seed=0).record["errors"]


@pytest.mark.parametrize(
    ("track", "told"),
    [
        ("{}['b']", f"KeyError: 'b' (my_tracker.py:{LINE['track']} in track)"),
        ("helper(image)", f"LinAlgError: Singular matrix (my_tracker.py:{LINE['helper']} in helper)"),
        ("sys.exit(3)", f"SystemExit: 3 (my_tracker.py:{LINE['track']} in track)"),
        ("raise ValueError('a\\x1b[31m\\nb')", "ValueError: a\\x1b[31m b (my_tracker.py"),
        (
            "return None",
            f"[no-result] track returned None, not a uavbench.tracker.protocol.TrackResult (my_tracker.py:{20}",
        ),
        ("return self.pose", "[no-result] track returned Pose,"),
        ("return 'ok'", "[no-result] track returned str,"),
        ("return TrackResult(status='fine')", "ValueError: the status 'fine' is none of ok, ambiguous, lost"),
        (
            "return TrackResult(status='ok', cam_from_world=np.eye(4))",
            "[bad-result] cam_from_world is ndarray of shape",
        ),
        (
            "return TrackResult(status='ok', cam_from_world=Pose(np.eye(3), np.full(3, np.nan)))",
            "[bad-result] the pose",
        ),
        (
            "return TrackResult(status='ok', cam_from_world=Pose(2 * np.eye(3), np.zeros(3)))",
            "[bad-result] the rotation",
        ),
        ("from dataclasses import replace; return replace(ok, covariance=np.eye(3))", "[bad-result] the covariance is"),
        (
            "from dataclasses import replace; return replace(ok, covariance=-np.eye(6))",
            "[bad-result] the covariance has",
        ),
        (
            "from dataclasses import replace; return replace(ok, covariance=np.linalg.cholesky(np.eye(6) + 1))",
            "[bad-result] the covariance is not symmetric; is it a triangular factor of one? Then return L @ L.T",
        ),
        ("from dataclasses import replace; return replace(ok, stage_ms=3)", "[bad-result] stage_ms is not a mapping"),
        (
            "from dataclasses import replace; return replace(ok, stage_ms={'fit': float('nan')})",
            "[bad-result] stage_ms of fit is nan, not the milliseconds of a time",
        ),
        (
            "from dataclasses import replace; return replace(ok, stage_ms={'a': -1})",
            "[bad-result] stage_ms of a is -1.0",
        ),
        ("from dataclasses import replace; return replace(ok, inliers=2.5)", "[bad-result] inliers is float"),
    ],
)
def test_one_bad_frame_is_lost_and_told_with_its_place(mine, sequence, track, told):
    results = track_sequence(mine(f"if self.n == 3: {track}"), sequence, rate_hz=15.0, seed=0)
    assert results.ok.tolist() == [k != 3 for k in range(10)]
    (error,) = results.record["errors"]
    assert error.startswith(f"frame 3: {told}"), error
    assert "my_tracker.py:" in error
    assert "\x1b" not in error
    assert "\n" not in error


@pytest.mark.parametrize(
    ("raised", "told"),
    [
        (
            "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()",
            "Odd, whose message cannot be made (Zer",
        ),
        ("raise type('Odd', (Exception,), {'__str__': lambda self: 3})()", "Odd, whose message cannot be made (TypeEr"),
        ("import asyncio; raise asyncio.CancelledError()", "CancelledError: (my_tracker.py:"),
        ("raise GeneratorExit", "GeneratorExit: (my_tracker.py:"),
        ("exec('1 / 0')", "ZeroDivisionError: division by zero (my_tracker.py:"),
        ("next(iter(()))", "StopIteration: (my_tracker.py:"),
        ("from uavbench.trajectories.errors import UserError; raise UserError('no net')", "no net (my_tracker.py:"),
        ("from uavbench.tracker.protocol import check_image; check_image(3, 4)", "AttributeError: 'int' object has"),
        ("Pose.from_matrix(np.ones((4, 4)))", "ValueError: "),
    ],
)
def test_whatever_is_raised_is_told_with_its_place(mine, sequence, raised, told):
    found = errors(mine(f"if self.n == 3: {raised}"), sequence)
    assert len(found) == 1
    assert found[0].startswith(f"frame 3: {told}"), found
    assert f"(my_tracker.py:{LINE['track']} in track)" in found[0]
    with pytest.raises(UserError, match=rf"cannot be started: .*\(my_tracker\.py:{LINE['start']} in start\)"):
        errors(mine(start=raised.replace("self.n", "0")), sequence)


def test_a_tracker_of_ours_says_what_it_says_to_people(sequence):
    with pytest.raises(UserError, match=r"^the initial pose is not finite; give numbers$"):
        begin(Robust(), sequence, Pose(np.eye(3), np.full(3, np.nan)), np.random.default_rng(0))


@dataclass(frozen=True)
class Leaves:
    """A job that ends as it likes."""

    how: BaseException

    def __call__(self, content_hash, on_step):
        raise self.how


@pytest.mark.parametrize("how", [SystemExit(0), KeyError("b"), GeneratorExit()], ids=lambda how: type(how).__name__)
def test_a_job_of_a_plug_in_that_ends_as_it_likes_has_failed(tmp_path, how):
    with pytest.raises(
        JobFaultError, match=rf"^{type(how).__name__}: .*\(tests/tracker/test_blame\.py:\d+ in __call__\)$"
    ):
        run_job(
            Plugins(), "render it", Leaves(how), Made(Place(tmp_path / "a", tmp_path / "a" / "record.json"), "hash")
        )


CHECKED = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Mine:
    gain: float = 1.0
    def __post_init__(self):
        {}["b"]
    def start(self, structure, camera, cam_from_world, rng): ...
"""


def test_a_plug_in_whose_parameters_raise_is_a_mistake_in_the_file(tmp_path, monkeypatch):
    (tmp_path / "my_checked.py").write_text(CHECKED)
    (tmp_path / "tracker.toml").write_text('kind = "my_checked:Mine"\n')
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UserError, match=r"tracker: KeyError: 'b' \(my_checked\.py:8 in __post_init__\)"):
        load_tracker(tmp_path / "tracker.toml")


def test_numbers_of_numpy_are_taken_and_read_back(mine, sequence, tmp_path):
    tracker = mine("return TrackResult(status='lost', inliers=np.int64(4), stage_ms={'a': np.float32(2.5)})")
    results = track_sequence(tracker, sequence, rate_hz=15.0, seed=0)
    results.save(tmp_path / "results")
    assert type(results).load(tmp_path / "results").rows[3].inliers == 4


def test_a_start_that_raises_or_returns_no_run_is_told_with_its_place(mine, sequence):
    with pytest.raises(UserError, match=rf"cannot be started: RuntimeError: no weights \(my_tracker\.py:{11}"):
        errors(mine(start="raise RuntimeError('no weights')"), sequence)
    with pytest.raises(UserError, match="start returned None, which has no method `track`"):
        errors(mine(start="return None"), sequence)


def test_a_tracker_that_fails_on_every_frame_is_a_failed_job(mine, sequence, tmp_path):
    def done(track):
        folder = tmp_path / "a" / "b" / "results"
        work = Track("mine", mine(track), 15.0, 0, TRIAL, folder)
        work("hash", lambda done, total: None)
        job = Job(verb="track", name="track it", work=work, marker=folder / "record.json", content_hash="hash")
        outcome = Outcome(fresh=[job])
        count_failed_trackers([job], outcome)
        return outcome

    outcome = done("{}['b']")
    assert outcome.failed["track it"].startswith(
        "the tracker failed on all of its 10 frames; first: frame 0: KeyError: 'b'"
    )
    assert outcome.fresh == []
    assert done("return TrackResult(status='lost')").failed == {}
    assert done("if self.n: {}['b']").failed == {}


def test_check_tells_it_too_and_calls_it_faulty(mine, tmp_path):
    lines = list(check(mine("{}['b']"), tmp_path / "kept"))
    assert any(f"KeyError: 'b' (my_tracker.py:{LINE['track']} in track)" in line for line in lines)
    assert lines[-1] == "faulty"


@pytest.mark.parametrize("how", ["os._exit(0)", "os.kill(os.getpid(), 11)"])
def test_check_has_a_verdict_on_a_tracker_that_ends_its_process(mine, tmp_path, how):
    mine(f"import os; {how}")
    (tmp_path / "mine.toml").write_text('kind = "my_tracker:Mine"\n')
    result = CliRunner().invoke(main, ["check", str(tmp_path / "mine.toml"), "--keep", str(tmp_path / "kept")])
    assert result.exit_code == 1 and "faulty: the process that ran the tracker died" in result.output


def test_check_tells_a_tracker_in_python_that_differs_between_runs_of_its_rng(mine, tmp_path):
    start = "cam_from_world = Pose.exp([*(np.random.rand(3) * 1e-3), 0, 0, 0]) @ cam_from_world"
    lines = list(check(mine(start=start), tmp_path / "kept"))
    note = "note: a second run gave other poses; take all random numbers from `rng`, keep no state between runs"
    assert note in lines and lines[-1].startswith("good")


@dataclass(frozen=True)
class Fickle:
    """Repeats the true initial pose in another convention."""

    way: str

    def start(self, structure, camera, cam_from_world, rng):
        return FickleRun(WAYS[self.way](cam_from_world))


@dataclass(frozen=True)
class FickleRun:
    pose: Pose

    def track(self, image, stamp_ns):
        return TrackResult(status="ok", cam_from_world=self.pose)


def w_last(pose):
    w, x, y, z = pose.quaternion_wxyz
    return Pose.from_quaternion([x, y, z, w], pose.translation)


FLIP = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
WAYS = {
    "world_from_cam": lambda p: p.inverse(),
    "millimetres": lambda p: Pose(p.rotation, 1000 * p.translation),
    "centimetres": lambda p: Pose(p.rotation, 100 * p.translation),
    "OpenGL axes": lambda p: FLIP @ p,
    "w last": w_last,
    "world_from_cam, quaternions with w last": lambda p: w_last(p.inverse()),
    "world_from_cam, OpenGL axes (y up, z back), millimetres": lambda p: WAYS["millimetres"]((FLIP @ p).inverse()),
    "with the rotation of world_from_cam": lambda p: Pose(p.rotation.T, p.translation),
    "with the translation of world_from_cam": lambda p: Pose(p.rotation, p.inverse().translation),
    "feet": lambda p: Pose(p.rotation, p.translation / 0.3048),
    "a world with y up": lambda p: p @ Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3)),
    "a world with z down, x kept": lambda p: p @ FLIP,
    "OpenGL axes (y up, z back), a world with y up": lambda p: FLIP @ WAYS["a world with y up"](p),
    "body_from_world": lambda p: Sequence.load(TRIAL).cam_from_body.inverse() @ p,
}


UNKNOWN = {
    "degrees for radians": lambda p: Pose(Pose.exp([0, 0, 0, *np.degrees(p.log()[3:])]).rotation, p.translation),
    "nothing": lambda p: Pose.identity(),
    "a left-handed world": lambda p: Pose(
        np.diag([1.0, -1, 1]) @ p.rotation @ np.diag([1.0, 1, -1]), np.array([1, -1, 1]) * p.translation
    ),
}


@pytest.mark.parametrize("way", list(UNKNOWN))
def test_check_calls_poses_faulty_that_leave_the_given_one_at_once(way, tmp_path, monkeypatch):
    monkeypatch.setitem(WAYS, way, UNKNOWN[way])
    lines = list(check(Fickle(way), tmp_path / "kept"))
    assert lines[-1] == "faulty"
    assert any(line.startswith("[first-pose] frame 0: ") and "cam_from_world" in line for line in lines), lines


@pytest.mark.parametrize("way", list(WAYS))
def test_check_calls_poses_of_another_convention_faulty(way, tmp_path):
    lines = list(check(Fickle(way), tmp_path / "kept"))
    assert lines[-1] == "faulty"
    assert any(line.startswith("[convention]") and way in line for line in lines), lines


@dataclass(frozen=True)
class Inertial:
    """Notes what it is given."""

    def start(self, structure, camera, cam_from_world, rng, *, body):
        self.notes.append(body)
        return InertialRun(self.notes)

    notes = []  # noqa: RUF012


@dataclass(frozen=True)
class InertialRun:
    notes: list

    def sense(self, samples):
        self.notes.append(samples)

    def track(self, image, stamp_ns):
        self.notes.append(stamp_ns)
        return TrackResult(status="lost")


def test_a_tracker_gets_the_body_and_each_sample_once_before_its_frame(tmp_path, sequence):
    stamps = sequence.stamps_ns
    times = list(range(int(stamps[0]), int(stamps[-1]) + 20_000_000, 5_000_000))
    header = "stamp_ns,wx_rad_s,wy_rad_s,wz_rad_s,ax_m_s2,ay_m_s2,az_m_s2,gyro_bias_x_rad_s"
    (tmp_path / "imu.csv").write_text("\n".join([header, *(f"{t},0,0,0.25,0,0,9.81,0.666" for t in times)]) + "\n")
    moved = replace(sequence, folder=tmp_path)
    shutil.copytree(TRIAL / "frames", tmp_path / "frames")
    shutil.copy(TRIAL / "groundtruth.csv", tmp_path)
    for run in (track_sequence, run_from_anchors):
        Inertial.notes.clear()
        run(Inertial(), moved, rate_hz=5.0, seed=0)
        body, *rest = Inertial.notes
        assert body.sensors["imu"].columns == tuple(header.split(",")[1:7])
        np.testing.assert_array_equal(body.cam_from_body.matrix, sequence.cam_from_body.matrix)
        given = []
        for samples, stamp in zip(rest[::2], rest[1::2], strict=True):
            given += samples["imu"].stamps_ns.tolist()
            assert given[-1] <= stamp
            assert samples["imu"].values.shape[1] == 6
            assert samples["imu"].values.base is None
        assert given == [t for t in times if t <= rest[-1]]


class Reusing:
    """A run that writes every frame's results into the same arrays, as a filter does with its state."""

    def __init__(self):
        self.rotation, self.translation, self.covariance, self.stage_ms = np.eye(3), np.zeros(3), np.eye(6), {}

    def track(self, image, stamp_ns):
        self.translation += 1.0
        self.covariance *= 2.0
        self.stage_ms["update"] = float(stamp_ns)
        pose = Pose(self.rotation, self.translation)
        return TrackResult(status="ok", cam_from_world=pose, covariance=self.covariance, stage_ms=self.stage_ms)


def test_results_stay_as_they_were_given_though_a_tracker_writes_to_its_arrays_again():
    """Else all frames of a run would have the covariance of the last one."""
    run = Reusing()
    results = [track_frame(run, np.zeros((120, 160), np.uint8), stamp_ns).result for stamp_ns in (1, 2, 3)]
    assert [result.covariance[0, 0] for result in results] == [2.0, 4.0, 8.0]
    assert [result.cam_from_world.translation[0] for result in results] == [1.0, 2.0, 3.0]
    assert [result.stage_ms["update"] for result in results] == [1.0, 2.0, 3.0]


def test_no_tracker_can_change_the_structure_that_others_get():
    structure = Sequence.load(TRIAL).structure
    for name in ("vertices", "triangles", "face_normals", "face_points", "edges", "edge_segments", "bounds"):
        before = getattr(structure, name).copy()
        with contextlib.suppress(ValueError):
            getattr(structure, name)[:] = 0
        np.testing.assert_array_equal(getattr(structure, name), before)


def test_the_measured_time_is_the_total_whatever_the_tracker_calls_so(mine, sequence):
    tracker = mine(
        "import time; time.sleep(0.02); return TrackResult(status='lost', stage_ms={'total': 0.02, 'fit': 1})"
    )
    rows = track_sequence(tracker, sequence, rate_hz=15.0, seed=0).rows
    assert all(row.stage_ms["total"] >= 20.0 and row.stage_ms["fit"] == 1.0 for row in rows)
