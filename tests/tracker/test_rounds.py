"""Poses around guesses are scored in slices: each goes on where the one before stopped, and none is passed over."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import Limits, score_changes
from uavbench.tracker.robust.relocalization.scoring.rounds import Around, Rounds
from uavbench.tracker.robust.work import Work

ENOUGH = 10**12
SIZE = (0.4, 0.3, 0.3)
POSE = look_at(np.array([1.6, 1.2, 1.2]), (0.0, 0.0, 0.15))
AWAY = look_at(np.array([-2.5, 1.4, 0.4]), (0.5, 0.3, 0.3))
NEAR = look_at(np.array([1.65, 1.15, 1.25]), (0.02, 0.0, 0.2))


@pytest.fixture(scope="module")
def searcher():
    """The pose search of a box."""
    fitter = EdgeFitter(box(SIZE), CAMERA, np.random.default_rng(0), RobustConfig())
    return Relocator(fitter, CAMERA).searcher


@pytest.fixture
def rounds(searcher):
    return Rounds(searcher, RobustConfig().relocalization)


@pytest.fixture(scope="module")
def around(searcher):
    """The image of a box, and two guesses, of which the second one is near it."""
    image = Scene([box_corners(SIZE)], seed=3).render(POSE, noise_rng=np.random.default_rng(0))
    return Around(searcher.target(image, 20.0), [motion(AWAY), motion(NEAR)])


def in_slices(scored, allowed):
    """All candidates of so many slices as `scored` takes, each of which may do some work; none may do more."""
    found = []
    for _ in range(400):
        work = Work(ENOUGH)
        before = scored(work, allowed, found)
        assert work.done <= allowed
        if before:
            return found
    raise AssertionError("the slices do not come to an end")


def test_each_guess_has_its_turn_though_the_first_one_takes_all_the_work_of_a_slice(rounds, around):
    at_once = rounds.near(around, Work(ENOUGH), ENOUGH)
    rounds.begin()

    def near(work, until, found):
        found += rounds.near(around, work, until)
        return rounds.next_guess >= len(around.guesses)

    found = in_slices(near, 100_000)
    best = max(found, key=lambda each: each.score)
    assert best.score == at_once[0].score
    np.testing.assert_array_equal(best.pose.R, at_once[0].pose.R)


@pytest.mark.parametrize("allowed", [300_000, 700_000, 5_000_000])
def test_far_from_the_guesses_slices_find_what_one_of_any_length_finds(rounds, around, allowed):
    at_once = max(rounds.far(around, Work(ENOUGH), ENOUGH), key=lambda each: each.score)
    assert rounds.is_complete(len(around.guesses))
    rounds.begin()
    assert not rounds.is_complete(len(around.guesses))

    def far(work, until, found):
        found += rounds.far(around, work, until)
        return rounds.is_complete(len(around.guesses))

    assert max(each.score for each in in_slices(far, allowed)) == at_once.score


def test_without_work_for_a_pose_nothing_is_done(rounds, around):
    work = Work(ENOUGH)
    assert rounds.near(around, work, rounds.least - 1) == []
    assert rounds.far(around, work, rounds.least - 1) == []
    assert work.done == 0


@pytest.mark.parametrize("part", [0.0, 0.3, 0.8])
def test_poses_are_scored_as_far_as_the_evaluations_go_and_as_without_a_limit(searcher, rounds, around, part):
    pose, block = around.guesses[1], rounds.near_block
    seen, changes = searcher.seen(pose), np.zeros((len(block.changes), 6))
    changes[:, 2:4] = block.changes

    def scored(evaluations):
        limits = Limits(evaluations, 1.0)  # no score is clear, so that none is left out
        return score_changes(seen, pose, changes, block.shifts, searcher.camera, around.target, limits)

    whole = scored(ENOUGH)
    assert whole.poses == len(changes)
    some = scored(int(part * whole.evaluations))
    assert some.evaluations <= part * whole.evaluations
    assert some.poses >= 0.5 * part * len(changes) - 1
    np.testing.assert_array_equal(some.scores[: some.poses], whole.scores[: some.poses])
    assert not some.scores[some.poses :].any()
