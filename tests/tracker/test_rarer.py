"""What a search fits again and keeps room for, and which poses it does not call right."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, flown, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import Ranking, Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

CONFIG = RobustConfig()
RANGE_M, PANEL_M = 0.9, 0.3
STEP_NS = 66_666_667


def off(pose, shift_m):
    """A pose at which the structure is moved along x of the world."""
    return Pose(pose.rotation, pose.translation + pose.rotation @ np.array([shift_m, 0.0, 0.0]))


class Searched:
    """Fits by a fitter that has learned nothing to an image of boxes along x, looked at from a pose."""

    def __init__(self, boxes, pose):
        self.boxes, self.pose = boxes, pose

    @cached_property
    def image(self):
        return Scene(self.boxes, seed=2).render(self.pose, noise_rng=np.random.default_rng(3))

    @cached_property
    def fitter(self):
        triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(self.boxes))])
        structure = Structure.from_mesh(np.concatenate(self.boxes), triangles)
        fitter = EdgeFitter(structure, CAMERA, np.random.default_rng(0), CONFIG)
        fitter.begin(0, 1.0)
        return fitter

    @cached_property
    def relocator(self):
        return Relocator(self.fitter, CAMERA)

    def at(self, shift_m):
        """The fit at the true pose, with the structure moved by so much along x."""
        pose, known = off(self.pose, shift_m), isotropic_covariance(0.005, RANGE_M)
        return self.fitter.searched(self.image, pose, known, StageClock(), 12.0)

    def sought(self, guess, thorough=False):
        wide = isotropic_covariance(0.1, RANGE_M)
        return Sought(self.image, [guess.cam_from_world], wide, RANGE_M, guess, thorough=thorough)

    def ranking(self, best, other):
        """The fits of a frame, with one of them the best whatever its support is."""
        found = Ranking(self.sought(best), CONFIG.relocalization)
        found.add(other)
        found.choose(best)
        return found


ONE_BOX = Searched([box_corners((0.12, 0.15, 0.25), (0.0, 0.0))], look_at(np.array([0.5, -0.7, 0.6]), (0, 0, 0.12)))
A_ROW = Searched(
    [box_corners((0.12, 0.15, 0.25), ((k - 5) * PANEL_M, 0.0)) for k in range(11)],
    look_at(np.array([1.2, -RANGE_M, 0.35]), (1.23, 0.0, 0.12)),
)
"""Seen at its end."""


def test_a_fit_that_finds_what_chance_explains_less_is_kept_beside_a_best_one_of_more_support():
    true, wrong = ONE_BOX.at(0.0), replace(ONE_BOX.at(0.1), support=0.95)
    ranking = ONE_BOX.ranking(wrong, true)
    assert true.support < wrong.support - CONFIG.relocalization.lead
    assert [each.fit for each in ranking.contenders()] == [wrong]
    assert ONE_BOX.relocator.rarer(ranking) == [true]
    ranking.believe_as_the_best([true])
    assert {each.fit for each in ranking.contenders()} == {wrong, true}


def test_a_fit_that_chance_explains_better_says_nothing_against_the_best_one():
    true, wrong = ONE_BOX.at(0.0), replace(ONE_BOX.at(0.1), support=0.95)
    assert ONE_BOX.relocator.rarer(ONE_BOX.ranking(true, wrong)) == []


@pytest.mark.parametrize("support", [0.0, 0.29])
def test_nor_does_one_of_less_support_than_any_pose_needs(support):
    true, wrong = replace(ONE_BOX.at(0.0), support=support), ONE_BOX.at(0.1)
    assert ONE_BOX.relocator.rarer(ONE_BOX.ranking(wrong, true)) == []


@pytest.mark.parametrize("panels", [1, 2])
def test_poses_at_which_the_structure_looks_alike_are_left_to_the_comparison_of_rivals(panels):
    """Both find real edges: which of them chance explains less tells little."""
    log10 = {fit: fit.chance.whole for fit in map(A_ROW.at, (0.0, -panels * PANEL_M))}
    rarer, best = sorted(log10, key=log10.__getitem__)
    assert log10[rarer] < log10[best] - 1.0
    assert A_ROW.relocator.rarer(A_ROW.ranking(best, rarer)) == []


@pytest.mark.parametrize(("powers_of_ten", "rarer"), [(0.5, False), (1.5, True)])
def test_after_a_loss_they_are_kept_side_by_side_where_one_is_clearly_rarer(powers_of_ten, rarer):
    """Behind a tree fewer of the true windows are found, by their share, than one bay beside; it is not dropped."""
    best = replace(A_ROW.at(-PANEL_M), support=0.95)
    chance = best.chance._replace(whole=best.chance.whole - powers_of_ten)
    true = replace(A_ROW.at(0.0), chance=chance, support=0.5)
    ranking = A_ROW.ranking(best, true)
    ranking.lost = True
    assert A_ROW.relocator.outdone_by_rarer(ranking) == rarer
    assert {each.fit for each in ranking.contenders()} == ({best, true} if rarer else {best})


@pytest.mark.parametrize(("lost", "lead"), [(False, CONFIG.relocalization.lead_of_rivals), (True, 0.1)])
def test_a_run_without_a_pose_needs_a_larger_lead_over_rivals(lost, lead):
    fit = ONE_BOX.at(0.0)
    found = Ranking(ONE_BOX.sought(fit)._replace(lost=lost), CONFIG.relocalization)
    assert found.worth(fit.support, fit.cam_from_world) - found.outdone == pytest.approx(lead)


@pytest.mark.parametrize(("found", "fits"), [(0.5, 1), (2.0, 2)])
def test_a_fit_that_finds_more_than_the_best_is_repeated_though_it_has_less_support(found, fits):
    """Its control points are those that are visible where it began, so that its support is too small."""
    best = ONE_BOX.at(0.0)
    worse = replace(ONE_BOX.at(0.1), support=0.0, found=found * best.found)
    ranking = Ranking(ONE_BOX.sought(best), CONFIG.relocalization)
    attempts = []
    for attempt in ONE_BOX.relocator.found(motion(off(ONE_BOX.pose, 0.1)), 0.0, ranking):
        attempts.append(attempt)
        ranking.add(worse)
    assert ranking.top is best and len(attempts) == fits
    np.testing.assert_array_equal(attempts[-1].pose.t, motion((worse if fits == 2 else off_fit()).cam_from_world).t)


def off_fit():
    """A fit whose pose is where the search began."""
    return replace(ONE_BOX.at(0.1), cam_from_world=off(ONE_BOX.pose, 0.1))


@pytest.mark.parametrize("support", [0.35, 0.9])
def test_room_is_left_for_the_rivals_of_any_fit_that_chance_does_not_explain(support):
    """The best of a search may be one panel off, with few of its edges found: then one of its rivals is right."""
    fit = replace(A_ROW.at(-PANEL_M), support=support)
    sought = A_ROW.sought(fit, thorough=True)
    ranking, tried = Ranking(sought, CONFIG.relocalization), TriedPoses(A_ROW.relocator.searcher)
    assert A_ROW.relocator.rivals.awaited(sought, ranking, tried) > 0


def test_what_held_a_fit_where_it_began_is_no_knowledge_of_its_pose():
    """A fit from close by ends where one from farther away does; their covariances are equal without the priors."""
    near, far = (isotropic_covariance(sigma, RANGE_M) for sigma in (0.002, 0.02))
    ONE_BOX.fitter.begin(0, 1.0)
    fits = [ONE_BOX.fitter.searched(ONE_BOX.image, ONE_BOX.pose, prior, StageClock(), 12.0) for prior in (near, far)]
    wide = np.linalg.inv(isotropic_covariance(CONFIG.relocalization.found_sigma, RANGE_M))
    freed = [fit.with_prior(wide) for fit in fits]
    sigmas = [fit.sigma for fit in (*fits, *freed)]
    assert sigmas[0] < 0.95 * sigmas[1]
    assert sigmas[2] == pytest.approx(sigmas[3], rel=0.02)
    assert all(fit.residuals.prior_information is wide for fit in freed)


def test_a_pose_that_is_not_known_well_enough_is_tracked_as_ambiguous():
    poses, images = flown(6, seed=11)
    statuses, errors_m = {}, {}
    for accuracy in (CONFIG.loss.accuracy, 1e-4):
        config = replace(CONFIG, loss=replace(CONFIG.loss, accuracy=accuracy))
        run = Robust(config).start(box(), CAMERA, poses[0], np.random.default_rng(0))
        results = [run.track(image, (k + 1) * STEP_NS) for k, image in enumerate(images)]
        told = [result.guess or result.cam_from_world for result in results]
        statuses[accuracy] = {result.status for result in results}
        errors_m[accuracy] = [
            np.linalg.norm(pose.inverse().translation - true.inverse().translation)
            for pose, true in zip(told, poses, strict=True)
        ]
    assert statuses == {CONFIG.loss.accuracy: {"ok"}, 1e-4: {"ambiguous"}}
    assert errors_m[1e-4] == errors_m[CONFIG.loss.accuracy]


@pytest.mark.parametrize("off_m", [0.0, 0.1])
def test_a_pose_is_not_outdone_by_its_own_fits_to_earlier_images(off_m):
    """They are moved by a prediction, and where that is off they end elsewhere; other poses of then still count."""
    fit, relocator = ONE_BOX.at(0.0), Relocator(ONE_BOX.fitter, CAMERA)
    relocator.tried.seen = fit.searched.problem.points.points
    here, elsewhere = motion(fit.cam_from_world), motion(off(ONE_BOX.pose, 0.25))
    relocator.move_along(here)
    relocator.tried.add(here, 0.0, here, 0.9)
    relocator.tried.add(elsewhere, 0.0, elsewhere, 0.4)
    relocator.best_before = here
    relocator.move_along(motion(off(fit.cam_from_world, off_m)))
    assert relocator.lead(replace(fit, support=0.9)) == pytest.approx(0.5)
