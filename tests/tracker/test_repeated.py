"""A fit from a prediction that is off is repeated from where it ends, with budget left or that a search would spend."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

KNOWN = 6
"""Frames before the one whose prediction is off."""
OFF = (
    [0.04, -0.032, 0.048, 0.016, 0.08, -0.048],
    [-0.03, 0.024, -0.036, -0.012, -0.06, 0.036],
    [-0.024, -0.024, -0.08, 0.0, -0.04, -0.08],
)
"""Twists by which it is, m and rad."""


def fitted(step_ns, off=OFF[0]):
    """Frame and fit from a prediction that is off, and what the decision takes it for; frames are step_ns apart."""
    poses, images = flown(KNOWN + 1, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i in range(KNOWN):
        assert run.track(images[i], i * step_ns).status == "ok"
    away = Pose.exp(np.array(off)) @ poses[KNOWN]
    away = Pose(np.ascontiguousarray(away.rotation), np.ascontiguousarray(away.translation))
    expected = Motion(away, 0.1**2 * np.eye(6))
    frame = run.frames.prepared(images[KNOWN], KNOWN * step_ns, expected, StageClock())
    fit = run.fitter.fit(frame.image, away, expected.covariance, StageClock())
    return run, frame, fit, run.follower.repeated(frame, fit, StageClock()), poses[KNOWN]


def error(fit, pose):
    return np.linalg.norm((fit.cam_from_world @ pose.inverse()).log())


@pytest.mark.parametrize("off", OFF)
def test_what_the_prediction_was_too_far_from_is_found_from_where_its_fit_ends(off):
    _, _, fit, again, pose = fitted(200_000_000, off)
    assert fit.support < 0.6 < 0.8 < again.support
    assert error(again, pose) < 0.1 * error(fit, pose)


def test_a_fit_that_finds_no_more_from_there_is_kept():
    run, frame, _, again, _ = fitted(200_000_000)
    last = again
    for _ in range(6):
        again, last = run.follower.repeated(frame, again, StageClock()), again
    assert again is last


@pytest.mark.parametrize("step_ns", [66_666_667, 33_333_333])
def test_frames_close_together_have_budget_for_it_where_they_would_search(step_ns):
    run, frame, fit, again, pose = fitted(step_ns)
    assert run.config.budget.is_least(frame.step_s)
    assert fit.support < run.config.good_support < again.support
    assert error(again, pose) < 0.1 * error(fit, pose)
    assert run.follower.repeated(frame, again, StageClock()) is again
