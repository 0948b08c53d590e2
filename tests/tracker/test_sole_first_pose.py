"""A first pose that leads and that chance does not find is followed, though a frame's budget left poses untried."""

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import SEARCHED_POSES, SURE
from uavbench.tracker.robust.relocalization.relocate import Relocalized
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock

STEP_NS = 200_000_000
BOXES = [box_corners((0.3, 0.2, 0.25), (-0.2, 0.1)), box_corners((0.2, 0.25, 0.15), (0.25, -0.1))]
TWO_BOXES = Structure.from_mesh(np.concatenate(BOXES), np.concatenate([BOX_TRIANGLES, BOX_TRIANGLES + 8]))
TRUE = look_at(np.array([-0.7, -0.9, 0.6]), (0.0, 0.0, 0.15))
WRONG = look_at(np.array([-0.55, -1.05, 0.6]), (0.0, 0.0, 0.15))


class FirstFrame:
    """The first frame of a run at 5 Hz from a wrong pose, and the fit at the right one."""

    def __init__(self):
        image = Scene(BOXES, seed=2).render(TRUE, noise_rng=np.random.default_rng(3))
        self.run = Robust().start(TWO_BOXES, CAMERA, WRONG, np.random.default_rng(0))
        self.frame = self.run.frames.prepared(image, STEP_NS, None, StageClock())
        self.found = self.run.fitter.searched(image, TRUE, isotropic_covariance(0.005, 1.2), StageClock())

    def decided(self, monkeypatch, fit, *, leads):
        """The decision where a search has found this fit when the budget ended, before all likely poses were tried."""
        found = Relocalized(fit, np.inf, False, False, leads, False, False, (), ())
        monkeypatch.setattr(self.run.decider.relocator, "search", lambda *_: found)
        monkeypatch.setattr(self.run.decider, "prior_constrained", lambda *_: None)
        monkeypatch.setattr(self.run.decider.doubts, "better", lambda *_: None)
        return self.run.decider.decide(self.frame, self.found, StageClock())


@pytest.fixture
def first():
    return FirstFrame()


def test_it_is_followed_in_doubt(first, monkeypatch):
    assert first.found.log10_false_alarms(SEARCHED_POSES) < SURE
    decision = first.decided(monkeypatch, first.found, leads=True)
    assert decision.settled and decision.is_open and first.run.decider.beginnings.in_doubt


def test_one_that_does_not_lead_is_not(first, monkeypatch):
    assert not first.decided(monkeypatch, first.found, leads=False).settled


def test_one_that_chance_finds_is_not(first, monkeypatch):
    poor = first.run.fitter.searched(first.frame.image, WRONG, isotropic_covariance(0.001, 1.2), StageClock())
    assert poor.log10_false_alarms(SEARCHED_POSES) >= SURE
    assert not first.decided(monkeypatch, poor, leads=True).settled
