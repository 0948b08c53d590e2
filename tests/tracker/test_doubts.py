"""A first pose that was searched is doubted until the poses around it have been tried."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.decision import beginnings
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.fit.false_alarms import Chance
from uavbench.tracker.robust.fit.pose_fit import CERTAIN, Fit
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization import doubts as doubts_module
from uavbench.tracker.robust.relocalization.doubts import ENOUGH, MOST_FRAMES, Doubts
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
CONFIG = RobustConfig()


def off(pose, shift_m, turn_rad):
    """A pose moved along x, and turned about y."""
    moved = Pose.exp(np.array([shift_m, 0.0, 0.0, 0.0, turn_rad, 0.0])) @ pose
    return Pose(np.ascontiguousarray(moved.rotation), np.ascontiguousarray(moved.translation))


def error_m(pose, true):
    return np.linalg.norm(pose.inverse().translation - true.inverse().translation)


class Doubted:
    """Doubts of a tracker of a box in one image; `after` frames of another fitter's doubts."""

    def __init__(self, seed=11, config=CONFIG):
        poses, images = flown(1, seed=seed)
        self.true, self.image = poses[0], images[0]
        self.range_m = float(np.linalg.norm(self.true.transform(box().bounds.mean(axis=0)[None])))
        self.fitter = EdgeFitter(box(), CAMERA, np.random.default_rng(0), config)
        self.doubts = Doubts(Relocator(self.fitter, CAMERA))

    def held(self, pose):
        """A fit that is held at a pose."""
        self.begin()
        fit = self.fitter.searched(self.image, pose, isotropic_covariance(0.005, self.range_m), StageClock(), 12.0)
        return replace(fit, cam_from_world=pose)

    def begin(self):
        self.fitter.begin(0, 0.066)

    def after(self, fit: Fit, frames: int) -> Fit | None:
        """The better fit that so many frames find, if any does."""
        self.doubts.begin(fit)
        for _ in range(frames):
            self.begin()
            if (better := self.doubts.better(self.image, fit, self.range_m)) is not None:
                return better
        return None


@pytest.mark.parametrize(("shift_m", "turn_rad"), [(0.05, 0.0), (-0.04, 0.03), (0.03, -0.05)])
def test_a_wrong_pose_is_left_for_the_right_one(shift_m, turn_rad):
    there = Doubted()
    better = there.after(there.held(off(there.true, shift_m, turn_rad)), 8)
    assert better is not None
    assert error_m(better.cam_from_world, there.true) < 0.01
    assert not there.doubts.settled  # the new one is doubted as well


@pytest.mark.parametrize("settled", [True, False])
def test_a_right_pose_is_kept_and_beyond_doubt_unless_chance_explains_it(monkeypatch, settled):
    monkeypatch.setattr(doubts_module, "is_by_chance", lambda *_: not settled)
    there = Doubted()
    fit = there.held(there.true)
    assert there.after(fit, 8) is None
    assert there.doubts.surrounding == ENOUGH and there.doubts.settled == settled


def test_what_is_learned_at_a_wrong_pose_has_no_say():
    there = Doubted()
    wrong = there.held(off(there.true, 0.05, 0.0))
    there.fitter.appearance[:] = 77.0
    better = there.after(wrong, 8)
    assert better is not None and error_m(better.cam_from_world, there.true) < 0.01
    assert not there.doubts.innocent.appearance.any()


def test_it_ends_where_budgets_are_too_small_for_a_fit():
    config = replace(CONFIG, budget=replace(CONFIG.budget, evaluations=1))
    fitter = EdgeFitter(box(), CAMERA, np.random.default_rng(0), config)
    doubts = Doubts(Relocator(fitter, CAMERA))
    there = Doubted()
    fit = there.held(there.true)
    doubts.begin(fit)
    for _ in range(MOST_FRAMES):
        assert not doubts.surrounded
        fitter.begin(0, 0.066)
        assert doubts.better(there.image, fit, there.range_m) is None
    assert doubts.surrounded and doubts.surrounding == 0


@pytest.mark.parametrize(
    ("turn_rad", "log10_less_likely", "settled"),
    [
        (0.0, 0.0, True),
        (0.01, 0.0, True),
        (0.03, 0.0, False),
        (0.03, -4.0, False),
        (0.03, 4.0, True),
        (0.3, 2.0, False),
    ],
)
def test_a_pose_stays_doubted_while_fits_around_it_end_elsewhere_and_are_about_as_likely(
    monkeypatch, turn_rad, log10_less_likely, settled
):
    """Neither fits that end within what an accepted pose may be off nor unlikely ones leave it open."""
    there = Doubted()
    base = there.held(there.true)
    elsewhere = Chance(base.chance.edges, base.chance.whole + log10_less_likely)
    ends = base, replace(base, cam_from_world=off(there.true, 0.0, turn_rad), chance=elsewhere)
    monkeypatch.setattr(there.doubts, "anew", lambda *_: base)
    monkeypatch.setattr(there.doubts.innocent, "searched", lambda *_: ends[there.doubts.tried % 2])
    assert there.after(base, 8) is None
    assert there.doubts.surrounded == settled


@pytest.mark.parametrize(("turn_rad", "begins_again"), [(0.0, False), (0.01, False), (0.03, True)])
def test_a_better_fit_at_the_same_pose_is_no_reason_to_begin_again(monkeypatch, turn_rad, begins_again):
    """Support varies by more than a lead among fits of one pose: of these the best would be begun at in each frame."""
    there = Doubted()
    held = replace(there.held(there.true), chance=Chance(-20.0, -20.0))
    base = replace(held, support=0.5 * held.support)
    better = replace(held, cam_from_world=off(there.true, 0.0, turn_rad))
    monkeypatch.setattr(there.doubts, "anew", lambda *_: base)
    monkeypatch.setattr(there.doubts.innocent, "searched", lambda *_: better)
    assert (there.after(base, 8) is better) == begins_again
    assert there.doubts.surrounded != begins_again


def test_frames_without_room_are_counted_anew_where_the_poses_around_are(monkeypatch):
    """Few frames without room among many fits that end elsewhere are no reason to believe one of them."""
    there = Doubted()
    base = there.held(there.true)
    ends = base, replace(base, cam_from_world=off(there.true, 0.0, 0.03))
    monkeypatch.setattr(there.doubts, "anew", lambda *_: base)
    monkeypatch.setattr(there.doubts.innocent, "searched", lambda *_: ends[there.doubts.tried % 2])
    there.doubts.begin(base)
    there.doubts.without_room = MOST_FRAMES - 1
    for _ in range(8):
        there.begin()
        assert there.doubts.better(there.image, base, there.range_m) is None
    assert there.doubts.without_room == 0 and not there.doubts.surrounded


@pytest.mark.parametrize(("log10_nfa", "by_chance"), [(-4.0, True), (-6.0, False)])
def test_a_better_pose_is_judged_as_the_best_of_all_frames_so_far(monkeypatch, log10_nfa, by_chance):
    """Among many frames chance finds one in which a wrong pose stands out."""
    there = Doubted()
    held = there.held(there.true)
    found = replace(held, chance=Chance(log10_nfa - 9.0, log10_nfa - 9.0))
    base = replace(held, support=0.5 * held.support, chance=CERTAIN)
    there.doubts.begin(base)
    there.doubts.judged = 100
    monkeypatch.setattr(there.doubts, "anew", lambda *_: base)
    monkeypatch.setattr(there.doubts, "best_around", lambda *_: found)
    assert there.doubts.better(there.image, base, there.range_m) is found
    assert there.doubts.by_chance == by_chance


def off_by_4_percent(pose):
    return off(pose, 0.04 * float(np.linalg.norm(pose.transform(box().bounds.mean(axis=0)[None]))), 0.07)


def chance_explains_all(monkeypatch):
    """Let doubts see chance in all poses: each first pose that is not the initial one is doubted for ever."""
    monkeypatch.setattr(doubts_module, "is_by_chance", lambda *_: True)


def test_a_pose_that_chance_explains_is_tracked_as_ambiguous_and_never_ok(monkeypatch):
    chance_explains_all(monkeypatch)
    poses, images = flown(12, seed=11)
    run = Robust().start(box(), CAMERA, off_by_4_percent(poses[0]), np.random.default_rng(0))
    results = [run.track(image, i * STEP_NS) for i, image in enumerate(images)]
    began = [result.status for result in results].index("ambiguous")
    assert {result.status for result in results[began:]} == {"ambiguous"} and began <= 4
    assert run.decider.doubts.surrounded
    for result, true in zip(results[began:], poses[began:], strict=True):
        assert error_m(result.guess, true) < 0.01


def test_a_doubted_pose_that_a_frame_does_not_confirm_is_forgotten_with_all_that_was_learned_there(monkeypatch):
    chance_explains_all(monkeypatch)
    poses, images = flown(12, seed=11)
    run = Robust().start(box(), CAMERA, off_by_4_percent(poses[0]), np.random.default_rng(0))
    initial = replace(run.state)
    seen = [run.track(image, i * STEP_NS).status for i, image in enumerate(images[:8])]
    assert seen[-1] == "ambiguous" and run.fitter.appearance.any() and not run.state.is_first
    plain = np.random.default_rng(0).integers(118, 122, images[0].shape).astype(np.uint8)
    assert run.track(plain, 8 * STEP_NS).status == "lost"
    assert run.state.is_first and not run.fitter.appearance.any() and not len(run.fitter.texture)
    assert run.state.motion.cam_from_world is initial.motion.cam_from_world and run.state.range_m == initial.range_m
    assert [run.track(image, i * STEP_NS).status for i, image in enumerate(images[:8], 9)][-1] == "ambiguous"


def test_frames_are_ambiguous_until_then_and_ok_afterwards():
    poses, images = flown(12, seed=11)
    range_m = float(np.linalg.norm(poses[0].transform(box().bounds.mean(axis=0)[None])))
    run = Robust().start(box(), CAMERA, off(poses[0], 0.04 * range_m, 0.07), np.random.default_rng(0))
    results = [run.track(image, i * STEP_NS) for i, image in enumerate(images)]
    statuses = [result.status for result in results]
    began = statuses.index("ok")
    assert "ambiguous" in statuses[:began]
    assert set(statuses[began:]) == {"ok"} and began <= 8
    for result, true in zip(results, poses, strict=True):
        if result.status == "ok":
            assert error_m(result.cam_from_world, true) < 0.01
    told = [result for result in results if result.status == "ambiguous"]
    assert all(result.cam_from_world is None and result.guess is not None for result in told)


def test_an_initial_pose_that_the_image_supports_is_not_doubted():
    poses, images = flown(3, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    assert [run.track(image, i * STEP_NS).status for i, image in enumerate(images)] == ["ok"] * 3


def test_a_doubted_pose_is_compared_where_each_frame_is_searched_too(monkeypatch):
    """At 5 Hz a search takes what budget a frame has, and each frame is searched where support is never good."""
    poses, images = flown(36, seed=11)
    poses, images = poses[::3], images[::3]
    run = Robust().start(box(), CAMERA, off_by_4_percent(poses[0]), np.random.default_rng(0))
    search = run.decider.relocator.search

    def spending_all(sought):
        found, work = search(sought), run.fitter.work
        work.done = max(work.done, work.allowed)
        return found

    monkeypatch.setattr(run.decider, "search_is_due", lambda *_: True)
    monkeypatch.setattr(run.decider.relocator, "search", spending_all)
    results = [run.track(image, i * 3 * STEP_NS) for i, image in enumerate(images)]
    statuses = [result.status for result in results]
    assert "ambiguous" in statuses and statuses[-1] == "ok"
    for result, true in zip(results, poses, strict=True):
        if result.status == "ok":
            assert error_m(result.cam_from_world, true) < 0.01


@pytest.mark.parametrize(("by_chance", "status"), [(False, "ok"), (True, "ambiguous")])
def test_an_initial_pose_that_was_not_kept_vouches_for_no_pose_near_it_that_chance_explains(
    monkeypatch, by_chance, status
):
    """It may be wrong itself."""
    monkeypatch.setattr(beginnings, "is_by_chance", lambda *_: by_chance)
    poses, images = flown(1, seed=11)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    monkeypatch.setattr(run.decider, "prior_constrained", lambda *_: None)
    assert run.track(images[0], 0).status == status
