"""A track's fit is believed as far as chance would not find as much at a pose that is as near to the prediction."""

from dataclasses import replace
from math import log10

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.motion_model import Motion
from uavbench.tracker.robust.near_poses import log10_poses_as_near
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
APART_PX = 1.5
ALONG = np.array([0.3, -0.2, 0.1, 0.02, 0.05, -0.01])
"""Twist to a prediction, m and rad."""


@pytest.fixture(scope="module")
def run():
    """A run that has tracked a box for three frames."""
    poses, images = flown(3, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i, image in enumerate(images):
        run.track(image, i * STEP_NS)
    run.last = images[-1]
    return run


@pytest.fixture(scope="module")
def fit(run):
    """The fit to its last frame."""
    near = run.state.motion.predict(0.0, run.state.range_m, run.config.motion)
    return run.fitter.fit(run.last, near.cam_from_world, near.covariance, StageClock(), 5.0)


def away(fit, twist):
    """Prediction from which a fit is a twist away."""
    moved = Pose.exp(np.asarray(twist)) @ fit.cam_from_world
    return Pose(np.ascontiguousarray(moved.rotation), np.ascontiguousarray(moved.translation))


def seen_alike(fit, px):
    """The fit, as if its points moved by so many px in the root mean square for a metre or radian of any direction."""
    lines = fit.searched.problem.lines
    problem = fit.searched.problem._replace(lines=lines._replace(jacobian=np.sqrt(6.0) * px * np.eye(6)))
    return replace(fit, searched=fit.searched._replace(problem=problem))


@pytest.mark.parametrize("sigma", [0.01, 0.1, 3.0])
@pytest.mark.parametrize("px", [100.0, 400.0])
def test_they_fill_the_ball_through_the_fit_whatever_the_covariance_says(fit, px, sigma):
    """In six directions alike, of a ball of radius r there are (r / c)^6 cells of a side c."""
    predicted = Motion(away(fit, ALONG), sigma**2 * np.eye(6))
    cells = np.linalg.norm(ALONG) / (APART_PX / px)
    assert log10_poses_as_near(seen_alike(fit, px), predicted, APART_PX) == pytest.approx(6 * log10(cells), rel=1e-6)


def test_directions_in_which_nothing_looks_different_do_not_count(fit):
    sigmas = np.array([0.1, 0.1, 0.1, 1e-6, 1e-6, 1e-6])
    predicted = Motion(away(fit, [0.1, 0, 0, 0, 0, 0]), np.diag(sigmas**2))
    cells = 0.1 / (APART_PX / 200.0)
    assert log10_poses_as_near(seen_alike(fit, 200.0), predicted, APART_PX) == pytest.approx(3 * log10(cells), rel=1e-4)


def test_at_the_prediction_there_is_the_fit_alone(fit):
    assert log10_poses_as_near(fit, Motion(fit.cam_from_world, np.eye(6)), APART_PX) == 0.0


def test_a_prediction_of_no_covariance_excludes_no_pose(fit):
    assert log10_poses_as_near(fit, Motion(away(fit, ALONG), np.zeros((6, 6))), APART_PX) == np.inf


@pytest.mark.parametrize(("twist", "holds"), [(0.01 * ALONG, True), (ALONG, False)])
def test_few_edges_are_believed_near_the_prediction_alone(run, fit, twist, holds):
    """As where an occluder hides the rest, and a track at 5 Hz meets the line of a floor or of a skirting board."""
    few = replace(fit, support=0.7, edge_support=0.7, chance=Chance(-6.0, -6.0))
    predicted = Motion(away(fit, twist), 0.1**2 * np.eye(6))
    assert run.state.holds(few, predicted, searched=False, recent=True) == holds
    much = replace(few, chance=Chance(-12.0, -12.0))
    assert run.state.holds(much, predicted, searched=False, recent=True)
