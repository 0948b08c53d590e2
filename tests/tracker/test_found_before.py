"""What a slice of a search found comes first in the next one, and landmarks vouch for what is found near them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at, pose_error
from tests.tracker.third_frame import STEP_NS, third_frame
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.places.places import Recalled
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

CONFIG = RobustConfig()
RANGE_M, STEP_S, LEARNED = 2.0, 0.067, 4
WIDE = isotropic_covariance(0.2, RANGE_M)


class Searched:
    """A search that has found a box, of which some frames were seen before, in one frame, and goes on in the next."""

    def __init__(self):
        self.pose = look_at(np.array([1.6, 1.2, 1.2]), (0.0, 0.0, 0.15))
        self.scene = Scene([box_corners((0.4, 0.3, 0.3))], seed=3)
        self.fitter = EdgeFitter(box((0.4, 0.3, 0.3)), CAMERA, np.random.default_rng(0), CONFIG)
        self.relocator = Relocator(self.fitter, CAMERA)
        self.carried = self.moved([0.1, 0.05, 0.0, 0.02, 0.0, 0.0])
        for frame in range(LEARNED):
            image = self.begun(frame)
            fit = self.fitter.fit(image, self.pose, isotropic_covariance(0.005, RANGE_M), StageClock())
            self.fitter.learn(image, fit, STEP_S)
        self.slice(LEARNED, self.moved([0.05, 0.0, 0.02, 0.0, 0.03, 0.0]))

    def moved(self, twist):
        moved = Pose.exp(np.asarray(twist)) @ self.pose
        return Pose(np.ascontiguousarray(moved.rotation), np.ascontiguousarray(moved.translation))

    def begun(self, frame):
        """The image of a frame, of which nothing was done yet."""
        self.fitter.begin(frame * STEP_NS, STEP_S)
        return self.scene.render(self.pose, noise_rng=np.random.default_rng(frame))

    def slice(self, frame, guess, fits=8):
        """The outcome of a slice with room for so many fits, around a guess."""
        image = self.begun(frame)
        self.fitter.work.allowed = self.fitter.work.done + self.fitter.cost(fits)
        sought = Sought(image, [guess], WIDE, RANGE_M, carried=self.carried, lost=True)
        return self.relocator.search(sought)


def test_what_a_slice_found_is_found_in_the_next_one_though_another_guess_is_likelier_now():
    """Of two hypotheses now the other one is the likeliest: the camera has not jumped from one to the other."""
    searched = Searched()
    assert searched.relocator.found_before
    assert pose_error(Pose(*searched.relocator.best_before), searched.pose)[0] < 0.01
    found = searched.slice(LEARNED + 1, searched.moved([0.9, 0.3, 0.4, 0.0, 0.3, 0.0]), fits=2).fit
    assert pose_error(found.cam_from_world, searched.pose)[0] < 0.01


def test_a_search_that_starts_anew_has_found_nothing():
    searched = Searched()
    searched.relocator.forget()
    assert not searched.relocator.found_before


@pytest.fixture(scope="module")
def tracked():
    """The run of a box, two frames old, the third frame, and its fit."""
    return third_frame()


@pytest.mark.parametrize("found_before", [False, True])
def test_nothing_is_recalled_where_the_last_slice_found_a_pose(tracked, monkeypatch, found_before):
    """To recall takes what that pose and its rivals need of the frame's work."""
    decider = tracked.run.decider
    monkeypatch.setattr(decider.relocator, "found_before", found_before)
    monkeypatch.setattr(decider.places, "recalled", lambda image, work, reserve: Recalled([], [tracked.fit]))
    recalled = decider.recall(tracked.frame, replace(tracked.fit, support=0.1))
    assert bool(recalled.alike) != found_before


@pytest.mark.parametrize(
    ("log10_chance", "apart_m", "held"), [(-13.0, 0.0, True), (-13.0, 0.3, False), (-12.0, 0.0, False)]
)
def test_a_fit_where_landmarks_are_is_found_among_fewer_poses(tracked, log10_chance, apart_m, held):
    """Among the 256 hypotheses of a fit hardly one is as good by chance, among all poses of a search some may be."""
    fit = replace(tracked.fit, support=0.35, edge_support=0.35, chance=Chance(log10_chance, log10_chance))
    at = fit.cam_from_world
    landmarks = [Pose(at.rotation, at.translation + np.array([apart_m, 0.0, 0.0]))]
    state, predicted = tracked.run.state, tracked.frame.predicted
    far = replace(predicted, cam_from_world=Pose(at.rotation, at.translation + np.array([0.5, 0.0, 0.0])))
    assert not state.holds(fit, far, searched=True, recent=False)
    assert state.holds(fit, far, searched=True, recent=False, landmarks=landmarks) == held
