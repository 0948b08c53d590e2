"""The score of a flight in closed loop against one whose every error is known beforehand."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from uavbench.reports.closed_loop.flown import GROUPS, Flown, FlownPath
from uavbench.reports.closed_loop.measures import (
    FlightScore,
    cameras_flown,
    cameras_planned,
    measure_flight,
    tracker_errors,
)
from uavbench.scenes.camera import Camera
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import TrackResult
from uavbench.tracker.results import Results
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Pose, rotation_exp
from uavbench.trajectories.trajectory import Trajectory

LOOKS_AHEAD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
MOUNT = Pose(LOOKS_AHEAD, np.array([0.3, -0.2, 0.1]))
CUBE = Structure.from_mesh(*box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0)))
CAMERA = Camera.from_field_of_view(200, 200, 90.0)
SECONDS = np.arange(0, 4.001, 0.02)
BODIES = [Pose(rotation_exp(np.array([0.1 * k, -0.2, 0.3])), np.array([-4.0 + k, 0.5, 1.0])) for k in range(5)]
"""True bodies at the five frames, 1 s apart: turned, so that a product in a wrong order shows."""


def path(**groups):
    """Two and a half metres along x, towards the cube and level; other values by their groups, each row or alike."""
    n = len(SECONDS)
    true_m = np.column_stack([np.linspace(-4.0, -1.5, n), np.zeros(n), np.ones(n)])
    values = {name: np.zeros((n, width)) for name, width in GROUPS.items()}
    values |= {"true_p_m": true_m, "planned_p_m": true_m, "estimated_p_m": true_m}
    values["true_q"] = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    for name, given in groups.items():
        values[name] = values[name] + given if name.endswith("p_m") else np.broadcast_to(given, values[name].shape)
    return FlownPath(np.rint(SECONDS * 1e9).astype(np.int64), np.hstack([values[name] for name in GROUPS]))


def answer(body, xi=(0.0,) * 6, covariance=None):
    """A tracker's answer that errs by the twist xi: cam_from_world_true = exp(xi) cam_from_world."""
    true = MOUNT @ body.inverse()
    return TrackResult(status="ok", cam_from_world=Pose.exp(np.array(xi)).inverse() @ true, covariance=covariance)


def flown(rows=None, flown_path=None, innovations=(), plan=None, **flight):
    ended = {"status": "completed", "why": "", "ended_s": 4.0, "planned_s": 4.0, "open_loop_rms_m": 0.01}
    record = {
        "label": "a", "run": "a@1hz", "rate_hz": 1.0, "sequence": {"name": "cube"}, "seed": 3, "errors": [],
        "loop": {"corridor_m": 0.09, "coverage_px_m": 5.0}, "cam_from_body": MOUNT.matrix.tolist(),
        "flight": {**ended, "radius_m": 0.2, **flight},
    }  # fmt: skip
    stamps = np.arange(5) * 10**9
    rows = tuple(answer(body) for body in BODIES) if rows is None else tuple(rows)
    level = np.column_stack([np.arange(5.0), -4.0 + np.arange(5.0) / 2, np.zeros(5), np.ones(5), np.zeros(5)])
    truth = Trajectory.from_poses(stamps.tolist(), BODIES)
    results = Results(record, np.arange(5), stamps, rows)
    plan = level if plan is None else plan
    return Flown(results, truth, flown_path or path(), plan, stamps, innovations, CUBE, CAMERA)


def errors_of(n, usual, one):
    """n errors along (0.6, 0.8, 0), all of one size but the last."""
    sizes = np.full(n, usual)
    sizes[-1] = one
    return sizes, sizes[:, None] * [0.6, 0.8, 0.0]


def test_path_and_estimate_errors_are_those_that_were_put_in():
    n = len(SECONDS)
    planned, away = errors_of(n, 0.03, 0.09)
    estimated, off = errors_of(n, 0.05, 0.2)
    off[:10] = np.nan  # before the estimator has begun
    nees = np.full((n, 1), 18.0)
    nees[:10], nees[10] = np.nan, 18.0 + 9 * (n - 10)
    score = measure_flight(flown(flown_path=path(
        planned_p_m=away, estimated_p_m=off, nees=nees, gnss_fix=np.arange(n)[:, None] < n // 3)))  # fmt: skip
    rms = np.sqrt((planned**2).mean())
    assert (score.path_rms_m, score.path_max_m) == (pytest.approx(rms), pytest.approx(0.09))
    assert score.path_added_m == pytest.approx(rms - 0.01)
    assert score.estimate_rms_m == pytest.approx(np.sqrt((estimated[10:] ** 2).mean()))
    assert score.estimate_max_m == pytest.approx(0.2)
    assert score.estimate_nees == pytest.approx(3.0), "2, and one of n more, by 9 degrees of freedom"
    assert score.gnss_share == pytest.approx((n // 3) / n)
    assert score.clearance_min_m == pytest.approx(0.5 - 0.2), "of the sphere, from the face at x = -1"
    assert (score.run, score.seed, score.sequence, score.rate_hz) == ("a@1hz", 3, "cube", 1.0)


@pytest.mark.parametrize(
    ("status", "away_m", "success"),
    [("completed", 0.0899, True), ("completed", 0.0901, False), ("crashed", 0.0, False), ("timeout", 0.0, False)],
)
def test_a_flight_succeeds_when_it_ends_and_never_leaves_its_corridor(status, away_m, success):
    _, away = errors_of(len(SECONDS), 0.0, away_m)
    assert measure_flight(flown(flown_path=path(planned_p_m=away), status=status)).success is success


def test_errors_of_the_tracker_are_those_of_the_body_and_its_nees_that_of_the_cameras_twist():
    """A turn by 6 deg about the body's own origin, and a shift of 4 cm, in the world's axes."""
    P = np.diag([0.01, 0.04, 0.09, 0.1, 0.2, 0.3]) ** 2
    turned = Pose(rotation_exp(np.radians([6.0, 0, 0])) @ BODIES[1].rotation, BODIES[1].translation)
    moved = Pose(BODIES[2].rotation, BODIES[2].translation + np.array([0.0, 0.04, 0.0]))
    rows = [
        answer(BODIES[0], (0.02, 0.04, -0.09, 0.2, 0.2, 0.0), P),
        answer(turned, covariance=np.zeros((6, 6))),
        answer(moved),
        TrackResult(status="lost"),
        answer(BODIES[4], covariance=np.eye(6)),
    ]
    found = tracker_errors(flown(rows))
    np.testing.assert_allclose(found.metres[1:], [0.0, 0.04, np.nan, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.degrees[1:], [6.0, 0.0, np.nan, 0.0], atol=1e-5)
    np.testing.assert_allclose(found.nees, [4 + 1 + 1 + 4 + 1, np.nan, np.nan, np.nan, 0.0], atol=1e-9)
    score = measure_flight(flown(rows))
    assert score.tracker_nees == pytest.approx(11 / 2 / 6)
    assert (score.frames, score.ok_share) == (5, pytest.approx(0.8))


def beside(k, metres=0.0, degrees=0.0):
    """An answer that puts the body of a frame beside its place."""
    turn = rotation_exp(np.radians([0.0, 0.0, degrees]))
    return answer(Pose(turn @ BODIES[k].rotation, BODIES[k].translation + np.array([metres, 0.0, 0.0])))


def test_the_first_false_pose_is_beyond_5_cm_or_5_deg_and_is_counted_to_the_crash():
    good = [beside(0), beside(1, 0.049, 4.9)]
    shifted = [*good, beside(2, 0.051), beside(3), beside(4, 0.2)]
    score = measure_flight(flown(shifted, status="crashed", ended_s=3.7))
    assert (score.first_false_s, score.false_to_crash_s) == (2.0, pytest.approx(1.7))
    assert score.tracker_rms_m == pytest.approx(np.sqrt((0.049**2 + 0.051**2 + 0.2**2) / 5))
    turned = [*good, beside(2), beside(3, degrees=5.1), beside(4, degrees=9.0)]
    assert measure_flight(flown(turned, status="crashed", ended_s=3.7)).first_false_s == 3.0
    assert measure_flight(flown(shifted)).false_to_crash_s is None, "it did not crash"
    none = measure_flight(flown([*good, TrackResult(status="lost"), beside(3), beside(4)], status="crashed"))
    assert (none.first_false_s, none.false_to_crash_s) == (None, None)


def test_a_tracker_that_never_answers_has_no_errors():
    nothing = np.full(3, np.nan)
    blind = flown([TrackResult(status="lost")] * 5, flown_path=path(estimated_p_m=nothing, nees=np.nan))
    score = measure_flight(blind)
    assert (score.tracker_rms_m, score.tracker_nees, score.first_false_s, score.ok_share) == (None, None, None, 0.0)
    assert (score.estimate_rms_m, score.estimate_max_m, score.estimate_nees) == (None, None, None)


@pytest.mark.parametrize(
    ("told", "share"),
    [((), None), ((("Height", True),), None), ((("CameraPose", True), ("CameraPose", False), ("Height", True)), 0.5),
     ((("CameraPose", False),) * 3 + (("CameraPose", True),), 0.25)],
)  # fmt: skip
def test_refused_are_the_cameras_poses_alone(told, share):
    rows = [[k, kind, 1.0, 6, refused] for k, (kind, refused) in enumerate(told)]
    assert measure_flight(flown(innovations=rows)).refused_share == share


def test_cameras_sit_on_the_vehicle_and_look_where_it_does_twice_a_second():
    roll, level = rotation_exp(np.array([0.4, 0.0, 0.0])), np.eye(3)
    q = Pose(roll, np.zeros(3)).quaternion_wxyz
    plan = np.column_stack([SECONDS, np.zeros((len(SECONDS), 2)), np.ones(len(SECONDS)), np.full(len(SECONDS), 0.7)])
    at_a_plan = rotation_exp(np.array([0.0, 0.0, 0.7]))
    where = flown(flown_path=path(true_q=q), plan=plan)
    for cameras, body, first in (
        (cameras_flown(where), roll, [-4.0, 0.0, 1.0]),
        (cameras_planned(where), at_a_plan, [0.0, 0.0, 1.0]),
    ):
        assert len(cameras) == 9
        np.testing.assert_allclose(cameras[0].rotation.T, body @ LOOKS_AHEAD.T @ level, atol=1e-12)
        centre = body @ (-LOOKS_AHEAD.T @ MOUNT.translation) + first
        np.testing.assert_allclose(cameras[0].inverse().translation, centre, atol=1e-12)
    x = [pose.inverse().translation[0] for pose in cameras_flown(where)]
    np.testing.assert_allclose(np.diff(x), 2.5 / 8, atol=1e-12)


def test_coverage_is_that_of_the_flight_and_the_other_that_of_the_plan():
    score = measure_flight(flown())
    assert score.coverage > 0.1
    plan = flown().plan.copy()
    plan[:, 4] = np.pi  # with its back to the cube
    away = measure_flight(flown(plan=plan))
    assert (away.coverage, away.coverage_planned) == (score.coverage, 0.0)
    turned = replace(flown(), path=path(true_q=[0.0, 0.0, 0.0, 1.0]))
    assert measure_flight(turned).coverage == 0.0
    assert measure_flight(turned).coverage_planned == score.coverage_planned > 0.1


def test_a_score_is_read_back_as_it_was_and_what_is_none_is_named(tmp_path):
    score = measure_flight(flown())
    path = tmp_path / "score.json"
    score.save(path, "abc")
    assert FlightScore.load(path) == score
    said = json.loads(path.read_text())
    assert said.pop("made_by")
    assert said["content_hash"] == "abc" and path.read_text().endswith("}\n")
    assert {**said, "content_hash": "", "faults": tuple(said["faults"])} == {"content_hash": "", **asdict(score)}
    replace(score, coverage=0.25).save(path)
    assert FlightScore.load(path).coverage == 0.25 and json.loads(path.read_text())["content_hash"] == ""
    with pytest.raises(ValueError, match="JSON"):
        replace(score, path_rms_m=np.nan).save(tmp_path / "nan.json")
    for broken in ({**said, "seed": "x"}, {name: said[name] for name in said if name != "seed"}):
        (tmp_path / "broken.json").write_text(json.dumps(broken))
        with pytest.raises(
            UserError, match=r"broken.json: not the score of a flight: seed: .*; score the flight again"
        ):
            FlightScore.load(tmp_path / "broken.json")


def test_a_flight_without_a_frame_has_no_share():
    nothing = flown()
    results = Results(nothing.record, np.arange(0), np.arange(0), ())
    score = measure_flight(replace(nothing, results=results))
    assert (score.frames, score.ok_share, score.tracker_rms_m) == (0, 0.0, None)
