"""A first pose that a search found is told from those at which the structure looks alike, before it is believed."""

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.decision.beginnings import Untold
from uavbench.tracker.robust.decision.decider import Decision
from uavbench.tracker.robust.motion_model import FAR_CHI2, Motion, isotropic_covariance
from uavbench.tracker.robust.relocalization.look_alikes import Verdict
from uavbench.tracker.robust.relocalization.rivals import RIVAL_CHI2
from uavbench.tracker.robust.track_state import Within
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

PANEL_M, RANGE_M, STEP_NS = 0.3, 0.9, 66_666_667
BOXES, FRAMES = 9, 40
ROW = [box_corners((0.12, 0.15, 0.25), ((k - BOXES // 2) * PANEL_M, 0.0)) for k in range(BOXES)]
ROW_OF_BOXES = Structure.from_mesh(np.concatenate(ROW), np.concatenate([BOX_TRIANGLES + 8 * k for k in range(BOXES)]))


def before(right_m):
    """The camera before the row, so far to the right of its middle."""
    return look_at(np.array([right_m, -RANGE_M, 0.35]), (right_m + 0.03, 0.0, 0.12))


def off_m(pose, true):
    return float(np.linalg.norm(pose.inverse().translation - true.inverse().translation))


def tracked(way, start):
    """Statuses and errors in m of a run that starts at a wrong pose; of a frame without a pose, of its guess."""
    scene, noise = Scene(ROW, seed=2), np.random.default_rng(3)
    run, found = Robust().start(ROW_OF_BOXES, CAMERA, start, np.random.default_rng(0)), []
    for k, pose in enumerate(way):
        result = run.track(scene.render(pose, noise_rng=noise), k * STEP_NS)
        found.append((result.status, off_m(result.cam_from_world or result.guess, pose)))
    return found


@pytest.mark.parametrize("boxes", [0.3, 0.5])
def test_which_of_equal_boxes_is_seen_is_not_said(boxes):
    """Neither end of the row comes into view, so that the pose found may be a box beside the right one."""
    way = [before(x) for x in np.linspace(0.0, 0.2, FRAMES)]
    found = tracked(way, before(boxes * PANEL_M))
    assert all(status != "ok" or error_m < 0.02 for status, error_m in found)


class Verdicts:
    """A run whose first pose, so far beside the initial one, is not doubted any more but for its look-alikes."""

    def __init__(self, monkeypatch, beside_m=PANEL_M):
        self.pose, clock = before(0.0), StageClock()
        image = Scene(ROW, seed=2).render(self.pose, noise_rng=np.random.default_rng(3))
        self.run = Robust().start(ROW_OF_BOXES, CAMERA, before(beside_m), np.random.default_rng(0))
        self.decider = self.run.decider
        self.frame = self.run.frames.prepared(image, 0, None, clock)
        self.found = self.run.fitter.searched(image, self.pose, isotropic_covariance(0.005, RANGE_M), clock)
        monkeypatch.setattr(self.decider.doubts, "better", lambda *_: self.decider.doubts.end())
        searched = Decision(self.found, True, searched=True, holds=True)
        monkeypatch.setattr(self.decider, "initialized_or_recovered", lambda *_: searched)

    def decided(self, monkeypatch, verdict):
        """The decision on the frame where its look-alikes are compared with this outcome."""
        monkeypatch.setattr(self.decider, "told", lambda *_: verdict)
        return self.decider.decide(self.frame, self.found, StageClock())


@pytest.fixture
def searched(monkeypatch):
    return Verdicts(monkeypatch)


def test_it_stays_open_until_it_leads_its_look_alikes(searched, monkeypatch):
    assert searched.decided(monkeypatch, Verdict(searched.found, leads=False)).is_open
    assert searched.decider.beginnings.in_doubt
    told = searched.decider.beginnings.placed(searched.found, Verdict(searched.found, leads=True), StageClock())
    assert told is searched.found and not searched.decider.beginnings.in_doubt


def test_one_at_the_initial_pose_is_told_from_those_that_this_leaves_open(monkeypatch):
    """A start off by more than half of a repetition is nearer to the next one."""
    searched = Verdicts(monkeypatch, beside_m=0.01)
    assert searched.decided(monkeypatch, Verdict(searched.found, leads=False)).is_open
    beginnings = searched.decider.beginnings
    assert beginnings.doubts.settled and beginnings.in_doubt
    (reach,) = beginnings.untold.within.reach
    near, next_one = (reach.squared_mahalanobis(before(right_m)) for right_m in (0.01, PANEL_M))
    assert near < FAR_CHI2 and next_one > RIVAL_CHI2, "no farther than a given pose may be off"
    searched.decided(monkeypatch, None)
    assert not beginnings.in_doubt


def test_it_is_believed_where_the_structure_looks_alike_nowhere_else(searched, monkeypatch):
    searched.decided(monkeypatch, None)
    assert not searched.decider.beginnings.in_doubt


def test_it_is_forgotten_where_a_frame_does_not_confirm_it(searched, monkeypatch):
    searched.decided(monkeypatch, Verdict(searched.found, leads=False))
    searched.decider.beginnings.give_up_doubted(searched.frame.before)
    assert not searched.decider.beginnings.in_doubt and searched.decider.beginnings.untold is None


def test_where_the_camera_may_be_moves_along_with_the_track():
    """A look-alike is as far from where the camera might have been as when the pose was found."""
    start, found = before(0.0), before(0.25)
    searched = Untold(found, Within((Motion(start, isotropic_covariance(0.1, RANGE_M)),), RANGE_M))
    turned = Pose.exp([0.1, -0.05, 0.02, 0.03, 0.1, -0.02]) @ found
    moved = searched.moved_to(turned)
    assert moved.cam_from_world is turned
    (reach,) = moved.within.reach
    shift = Pose(np.eye(3), [PANEL_M, 0.0, 0.0])
    asked = searched.within.reach[0].cam_from_world
    then = ((found @ shift) @ asked.inverse()).log()
    now = ((turned @ shift) @ reach.cam_from_world.inverse()).log()
    np.testing.assert_allclose(np.linalg.norm(now[3:]), np.linalg.norm(then[3:]), atol=1e-9)
    assert np.linalg.norm(now[:3]) == pytest.approx(np.linalg.norm(then[:3]), rel=0.05)
