"""A track is matched where its poses usually are, and told by the image alone."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.fit.edge_fit import layered
from uavbench.tracker.robust.fit.pose_fit import MIN_POINTS
from uavbench.tracker.robust.fit.stage_kernels import align_by_patches
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.kernels.compiled import unchecked
from uavbench.trajectories.pose import Pose

KNOWN, STEP_NS = 12, 66_666_667
"""Frames before the one that is looked at, and the time between them."""


@lru_cache(maxsize=1)
def flight():
    return flown(KNOWN + 1, seed=11)


def after(known=KNOWN, expected=None, step_ns=STEP_NS, off=None):
    """A run after some frames, the next one, prepared, and its true pose; off: a twist by which its prediction is."""
    poses, images = flight()
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i in range(known):
        assert run.track(images[i], i * STEP_NS).status == "ok"
    stamp_ns = (known - 1) * STEP_NS + step_ns
    assert run.frames.is_new(images[known], stamp_ns)
    frame = run.frames.prepared(images[known], stamp_ns, expected, StageClock())
    if off is not None:
        away = Pose.exp(np.array(off)) @ poses[known]
        away = Pose(np.ascontiguousarray(away.rotation), np.ascontiguousarray(away.translation))
        moved = Motion(away, frame.predicted.covariance)
        frame = frame._replace(predicted=moved, likely=(frame.likely[0]._replace(predicted=moved),))
    return run, frame, poses[known]


def error(fit, pose):
    return np.linalg.norm((fit.cam_from_world @ pose.inverse()).log())


def test_the_covariance_is_that_of_the_image_and_not_of_the_usual_prediction():
    run, frame, pose = after()
    usual = run.follower.usual(frame)
    assert np.trace(usual) < 0.2 * np.trace(frame.predicted.covariance), "predictions must be good here"
    usual = 0.1 * usual
    held = run.follower.held(frame, usual, StageClock())
    free = run.fitter.fit(frame.image, frame.predicted.cam_from_world, frame.predicted.covariance, StageClock())
    twice = run.fitter.fit(frame.image, frame.predicted.cam_from_world, usual, StageClock())
    np.testing.assert_allclose(np.diag(held.covariance), np.diag(free.covariance), rtol=0.05)
    assert np.trace(twice.covariance) < 0.7 * np.trace(held.covariance)
    assert error(held, pose) < 0.004


def test_a_pose_as_usual_is_fitted_once():
    run, frame, _ = after()
    assert run.follower.fit(frame, StageClock()).searched.problem.covariance is frame.predicted.covariance
    once = run.fitter.work.done
    run.fitter.work.done = 0
    run.follower.held(frame, run.follower.usual(frame), StageClock())
    assert once == run.fitter.work.done


@pytest.mark.parametrize("off", [[0.02, 0.0, 0.01, 0.0, 0.02, 0.0], [0.0, -0.02, 0.0, 0.02, 0.0, 0.01]])
def test_after_an_unusual_motion_the_likelier_fit_counts(off):
    run, frame, pose = after(off=off)
    fit = run.follower.fit(frame, StageClock())
    free = run.fitter.fit(frame.image, frame.predicted.cam_from_world, frame.predicted.covariance, StageClock())
    assert error(fit, pose) < 0.004
    assert run.follower.worth(frame, fit) >= run.follower.worth(frame, free)


def test_a_well_supported_fit_elsewhere_gives_way_to_a_likelier_one_where_frames_are_far_apart(monkeypatch):
    """At 5 Hz a joint of panels above a window was taken for its upper edge: its support alone was good enough."""
    run, frame, pose = after(step_ns=3 * STEP_NS)
    right = run.follower.held(frame, run.follower.usual_covariance(frame), StageClock())
    aside = Pose(pose.rotation, pose.translation + np.array([0.0, 0.05, 0.0]))
    slid = replace(right, cam_from_world=aside, support=run.state.usual_or_good())
    assert slid.support < right.support
    monkeypatch.setattr(run.fitter, "fit", lambda *_, **__: slid)
    assert run.follower.usual(frame) is None
    assert error(run.follower.fit(frame, StageClock()), pose) < 0.004


@pytest.mark.parametrize("lost", [0, 1])
def test_a_pose_found_elsewhere_after_a_loss_tells_no_velocity(lost):
    """From a window to the next one nothing has moved: at 15 Hz it would be 20 m/s, one more window in each frame.

    But what a track follows from frame to frame may move as fast as it likes.
    """
    run, frame, pose = after()
    fit, known = run.follower.fit(frame, StageClock()), run.state.motion
    aside = replace(fit, cam_from_world=Pose(pose.rotation, pose.translation + np.array([0.3, 0.0, 0.0])))
    for found, tells in ((aside, not lost), (fit, True)):
        run.state.motion = known
        run.state.learn(frame.predicted, found, (1 + lost) * frame.dt_s, KNOWN * STEP_NS, frame.dt_s)
        assert run.state.motion.cam_from_world is found.cam_from_world
        assert (run.state.motion.velocity is not known.velocity) == tells


def test_patches_that_contradict_each_other_do_not_tell_where_to_look():
    """Of panes that mirror other things some are found elsewhere; each of them by itself may look right."""
    run, frame, pose = after()
    fitter, clock = run.fitter, StageClock()
    problem = fitter.project(layered(frame.image), pose, frame.predicted.covariance, clock)
    texture = fitter.texture
    texture.chosen = texture.chosen[: MIN_POINTS + 2]
    by_patches = unchecked(align_by_patches)
    assert by_patches(problem, texture.in_view, fitter.known_biases, fitter.values).told
    px = np.random.default_rng(2).uniform(-6, 6, (len(texture), 1, 2))
    texture.patches.middles[: len(texture)] += (px @ texture.patches.axes[: len(texture)])[:, 0]
    aligned, told = by_patches(problem, texture.in_view, fitter.known_biases, fitter.values)
    assert np.count_nonzero(aligned.matches.correlation > 0.0) >= MIN_POINTS
    assert not told
    np.testing.assert_array_equal(aligned.at.t, problem.at.t)


def test_nothing_is_usual_of_a_first_frame_one_after_a_pause_or_a_loss_or_a_vehicles_prediction():
    run, frame, pose = after()
    assert run.follower.usual(frame) is not None
    run.state.is_lost = True
    assert run.follower.usual(frame) is None
    known = Motion(Pose(np.ascontiguousarray(pose.rotation), pose.translation), 1e-6 * np.eye(6))
    for other in ({"known": 0}, {"step_ns": 3 * STEP_NS}, {"expected": known}):
        run, frame, _ = after(**other)
        assert run.follower.usual(frame) is None


@pytest.mark.parametrize("given", [np.float32, np.asfortranarray, list], ids=["float32", "columns", "lists"])
def test_a_predicted_covariance_may_be_of_any_numbers(given):
    """A filter of one's own works in single precision, or keeps its matrices by columns."""
    poses, images = flown(3, seed=11)
    told = []
    for covariance in (1e-8 * np.eye(6), given(1e-8 * np.eye(6))):
        run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
        for i in range(2):
            run.track(images[i], i * STEP_NS)
        run.predict(poses[2], covariance)
        told.append(run.track(images[2], 2 * STEP_NS))
    assert told[0].status == told[1].status == "ok"
    np.testing.assert_allclose(told[1].cam_from_world.matrix, told[0].cam_from_world.matrix, atol=1e-9)
