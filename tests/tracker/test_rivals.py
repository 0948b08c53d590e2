"""Rivals of a fit: what counts in a comparison of poses at which the structure looks alike."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.motion_model import isotropic_covariance
from uavbench.tracker.robust.relocalization.ranking import Ranking, Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.tried_poses import TriedPoses
from uavbench.tracker.robust.work import Work
from uavbench.tracker.stage_clock import StageClock
from uavbench.trajectories.pose import Pose

CONFIG = RobustConfig()
PANEL_M, RANGE_M = 0.3, 0.9


def row(count):
    """Corners of equal boxes along x."""
    return [box_corners((0.12, 0.15, 0.25), ((k - count // 2) * PANEL_M, 0.0)) for k in range(count)]


def fitter_of(corners):
    """A fitter of these boxes that has learned nothing."""
    triangles = np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(corners))])
    structure = Structure.from_mesh(np.concatenate(corners), triangles)
    return EdgeFitter(structure, CAMERA, np.random.default_rng(0), CONFIG)


def supports(count, learned):
    """Supports of fits of a row of equal boxes: at the true pose, in its middle; of its rival one box beside, and of
    that with what it lacks.

    learned: looks at the row before.
    """
    corners = row(count)
    fitter = fitter_of(corners)
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    scene, rng = Scene(corners, seed=2), np.random.default_rng(3)
    known = isotropic_covariance(0.005, RANGE_M)
    for k in range(learned):
        fitter.begin(k * 1_000_000_000, 1.0)
        image = scene.render(pose, noise_rng=rng)
        fitter.learn(image, fitter.fit(image, pose, known, StageClock()), 1.0)
    fitter.forget_patches()
    fitter.begin(learned * 1_000_000_000, 1.0)
    image = scene.render(pose, noise_rng=rng)
    top = fitter.searched(image, pose, known, StageClock())
    rivals, at = Relocator(fitter, CAMERA).rivals, top.cam_from_world
    beside = RigidMotion(at.rotation, at.translation - at.rotation @ np.array([PANEL_M, 0.0, 0.0]))
    rival = rivals.fitted(Sought(image, [at], known, RANGE_M, top), beside)
    return top.support, rival.support, rival.support + rivals.lacking(rival, top, beside)


@pytest.mark.parametrize("learned", [0, 1, 5])
def test_edges_that_were_seen_before_are_no_reason_to_stay_where_they_are(learned):
    """In the middle of a long row the image is the same from one box beside, whose edges nobody has seen yet."""
    top, rival, compared = supports(15, learned)
    assert compared == pytest.approx(top, abs=0.05)
    if learned:
        assert top - rival > 0.05


@pytest.mark.parametrize("learned", [0, 5])
def test_what_only_one_of_two_poses_shows_tells_them_apart(learned):
    """Of two boxes one is where the other pose shows nothing."""
    top, _, compared = supports(2, learned)
    assert compared < 0.85 * top


def test_a_pose_at_which_half_is_found_has_the_true_one_among_its_rivals():
    """From one box beside the end of a row, that end is not found: the true pose explains all that is."""
    corners = row(4)
    fitter = fitter_of(corners)
    pose = look_at(np.array([0.3, -RANGE_M, 0.35]), (0.33, 0.0, 0.12))
    image = Scene(corners, seed=2).render(pose, noise_rng=np.random.default_rng(3))
    fitter.begin(0, 1.0)
    beside = Pose(pose.rotation, pose.translation - pose.rotation @ np.array([-PANEL_M, 0.0, 0.0]))
    known = isotropic_covariance(0.005, RANGE_M)
    wrong = fitter.searched(image, beside, known, StageClock())
    rivals = Relocator(fitter, CAMERA).rivals
    shares = rivals.shares(wrong)
    to_truth = np.abs(rivals.similarity.shifts - [PANEL_M, 0.0, 0.0]).sum(axis=1).argmin()
    assert shares[to_truth] > 0.75
    points, along = wrong.searched.problem.points.points, rivals.along(wrong.searched)
    assert rivals.similarity.shares(points, along)[to_truth] < shares[to_truth] - 0.1  # of all points


@pytest.mark.parametrize("fits", range(3, 17))
def test_the_rivals_of_a_better_rival_count_whatever_the_budget(fits):
    """A search that ends between two boxes finds one beside them; the true pose is then a rival of that."""
    corners = row(9)
    fitter = fitter_of(corners)
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    image = Scene(corners, seed=2).render(pose, noise_rng=np.random.default_rng(3))
    fitter.begin(0, 1.0)
    top = fitter.searched(image, pose, isotropic_covariance(0.005, RANGE_M), StageClock())
    above = Pose(pose.rotation, pose.translation - pose.rotation @ np.array([0.0, 0.0, 0.02]))
    poor = replace(top, cam_from_world=above, support=0.3)
    sought = Sought(image, [pose], isotropic_covariance(0.2, RANGE_M), RANGE_M, poor, thorough=True)
    rivals, ranking = Relocator(fitter, CAMERA).rivals, Ranking(sought, CONFIG.relocalization)
    fitter.work = Work(fitter.cost(fits))
    rivals.fit(sought, ranking, TriedPoses(rivals.searcher))
    assert ranking.top is not poor
    away = [(fit.cam_from_world @ pose.inverse()).log() for fit in ranking.fits if fit is not poor]
    assert np.linalg.norm(away, axis=1).min() < 0.02


@pytest.mark.parametrize("goes_on", [False, True])
def test_a_rival_that_the_next_frame_is_to_fit_is_as_good_as_the_pose_that_it_looks_like(monkeypatch, goes_on):
    """Where no frame goes on with them, others tell of those without room once half of them were fitted."""
    fitter = fitter_of(row(9))
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    image = Scene(row(9), seed=2).render(pose, noise_rng=np.random.default_rng(3))
    fitter.begin(0, 0.1)
    top = fitter.searched(image, pose, isotropic_covariance(0.005, RANGE_M), StageClock())
    wide = isotropic_covariance(0.2, RANGE_M)
    sought = Sought(image, [pose], wide, RANGE_M, top, thorough=True, goes_on=goes_on)
    rivals, ranking = Relocator(fitter, CAMERA).rivals, Ranking(sought, CONFIG.relocalization)

    def poor(_, place):
        fitter.work.done += fitter.cost(1)
        return replace(top, cam_from_world=Pose(*place), support=0.3)

    monkeypatch.setattr(rivals, "fitted", poor)
    monkeypatch.setattr(rivals, "lacking", lambda *_: 0.0)
    awaited = len(rivals.of(sought, ranking, TriedPoses(rivals.searcher)))
    fitter.work = Work(fitter.cost(1) * (awaited - 1) + rivals.cost)
    compared = rivals.fit(sought, ranking, TriedPoses(rivals.searcher))
    assert awaited > 2 and compared.left
    assert {fit.support for fit in compared.left} == {top.support if goes_on else 0.3}


def test_the_rivals_of_a_track_take_no_room_from_a_later_search():
    """A search leaves room for as many as the last search had, not for those that a track was compared with."""
    fitter = fitter_of(row(15))
    pose = look_at(np.array([0.0, -RANGE_M, 0.35]), (0.03, 0.0, 0.12))
    image = Scene(row(15), seed=2).render(pose, noise_rng=np.random.default_rng(3))
    fitter.begin(0, 1.0)
    top = fitter.searched(image, pose, isotropic_covariance(0.005, RANGE_M), StageClock())
    rivals = Relocator(fitter, CAMERA).rivals
    thorough = Sought(image, [pose], isotropic_covariance(0.2, RANGE_M), RANGE_M, top, thorough=True)
    fitter.work = Work(fitter.cost(40))
    assert rivals.fit(thorough, Ranking(thorough, CONFIG.relocalization), TriedPoses(rivals.searcher)).any
    searched = thorough._replace(thorough=False)
    assert rivals.awaited(searched, Ranking(searched, CONFIG.relocalization), TriedPoses(rivals.searcher)) == 0
