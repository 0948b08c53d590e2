"""Where a doubted pose was tracked is remembered: where to look once it is given up, and no more."""

import numpy as np

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at
from uavbench.tracker.robust.decision.decider import Decision
from uavbench.tracker.robust.fit.pose_fit import Fit
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock

STEP_NS, RANGE_M = 66_666_667, 0.9
POSE = look_at(np.array([0.1, -RANGE_M, 0.5]), (0.0, 0.0, 0.1))


def begun():
    return Robust().start(box(), CAMERA, POSE, np.random.default_rng(0))


class Doubted:
    """A run whose first pose, 0.1 m beside the initial one, is doubted; `later`: the next frame."""

    def __init__(self):
        self.run, scene, noise = begun(), Scene([box_corners()], seed=2), np.random.default_rng(3)
        self.decider, self.pose = self.run.decider, look_at(np.array([0.2, -RANGE_M, 0.5]), (0.0, 0.0, 0.1))
        self.image, self.clock = scene.render(self.pose, noise_rng=noise), StageClock()
        self.frame = self.run.frames.prepared(self.image, 0, None, self.clock)
        self.decider.beginnings.note_begin()
        self.fit = self.run.fitter.searched(self.image, self.pose, isotropic_covariance(0.005, RANGE_M), self.clock)
        self.decider.beginnings.doubt_first(self.fit)
        self.decider.remember(self.frame, Decision(self.fit, True, is_open=True))
        self.later = self.run.frames.prepared(scene.render(self.pose, noise_rng=noise), STEP_NS, None, self.clock)

    def recalled(self):
        """Poses at which the next frame is sought, by what was seen."""
        nothing = Fit(POSE, np.eye(6), 0.0, 0, 0, 0, float("nan"))
        return [each.translation for each in self.decider.recall(self.later, nothing).alike]


def test_where_a_doubted_pose_was_tracked_is_searched_again_after_it_is_given_up():
    doubted = Doubted()
    doubted.run.learn(doubted.frame, doubted.fit, 0)
    doubted.decider.beginnings.give_up_doubted(doubted.frame.before)
    assert doubted.run.state.is_first and not doubted.decider.beginnings.in_doubt
    np.testing.assert_array_equal(doubted.recalled(), [doubted.fit.cam_from_world.translation])


def test_a_doubted_pose_tells_nothing_of_the_surface_until_it_is_told():
    doubted = Doubted()
    assert doubted.decider.places.last is None
    doubted.decider.remember(doubted.frame, Decision(doubted.fit, True))
    assert doubted.decider.places.last is not None and doubted.decider.beginnings.places.last is None


def test_another_pose_that_is_doubted_is_not_searched_where_the_last_one_was():
    doubted = Doubted()
    doubted.decider.beginnings.doubt_first(doubted.fit)
    assert doubted.recalled() == []
