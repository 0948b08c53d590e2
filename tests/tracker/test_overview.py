"""After a loss poses from all sides of the guesses are looked at, in slices of frames, and none is passed over."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.scoring.rounds import Around
from uavbench.tracker.robust.work import Work

ENOUGH = 10**12
SIZE = (0.4, 0.3, 0.25)
MIDDLE = (0.0, 0.0, 0.12)
RANGE_M = 1.3


def from_the(side_rad, height_m=0.55, range_m=RANGE_M):
    """The pose of a camera that looks at the box from a side."""
    across = np.sqrt(range_m**2 - height_m**2)
    return look_at(np.array([across * np.cos(side_rad), across * np.sin(side_rad), height_m]), MIDDLE)


@pytest.fixture(scope="module")
def candidates():
    fitter = EdgeFitter(box(SIZE), CAMERA, np.random.default_rng(0), RobustConfig())
    return Relocator(fitter, CAMERA).candidates


def around(candidates, image, *guesses):
    """The image, and guesses about which poses are looked at."""
    candidates.begin()
    return Around(candidates.searcher.target(image, 1e3), [motion(guess) for guess in guesses])


def off_by(pose, candidate):
    """Angle between the viewing directions of a pose and a candidate on the middle of the box, degrees."""
    centres = [-R.T @ t - np.array(MIDDLE) for R, t in (motion(pose), candidate.pose)]
    cosine = np.dot(*centres) / np.prod([np.linalg.norm(centre) for centre in centres])
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


@pytest.mark.parametrize("away_deg", [-70, -50, 35, 60])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_box_is_seen_from_a_side_far_from_the_guess(candidates, away_deg, seed):
    """Rounds of scoring look 23 degrees to either side."""
    pose = from_the(0.7 + np.radians(away_deg), 0.6, 1.1 * RANGE_M)
    image = Scene([box_corners(SIZE)], seed=seed).render(pose, noise_rng=np.random.default_rng(seed))
    poses = around(candidates, image, from_the(0.7))
    found = candidates.overview.found(image, poses, RANGE_M, Work(ENOUGH), ENOUGH)
    assert candidates.overview.is_complete(1)
    assert min(off_by(pose, each) for each in found) < 8.0
    nearest = candidates.rounds.far(poses, Work(ENOUGH), ENOUGH)
    assert min(off_by(pose, each) for each in nearest) > 8.0


@pytest.mark.parametrize("allowed", [1_500_000, 2_500_000])
def test_slices_look_at_each_view_of_each_guess_once_and_obey_their_limit(candidates, allowed):
    pose = from_the(0.2)
    image = Scene([box_corners(SIZE)], seed=3).render(pose, noise_rng=np.random.default_rng(0))
    poses = around(candidates, image, from_the(1.0), from_the(-0.9))
    overview, seen = candidates.overview, []
    best_there = overview.coarse.best_there

    def watched(target, pose, seen_edges, block, most):
        seen.append((block.azimuth_rad, block.elevation_rad))
        return best_there(target, pose, seen_edges, block, most)

    overview.coarse.best_there = watched
    try:
        slices = []
        while not overview.is_complete(2):
            work = Work(ENOUGH)
            slices.append(overview.found(image, poses, RANGE_M, work, allowed))
            assert 0 < work.done <= allowed
    finally:
        del overview.coarse.best_there
    assert len(slices) > 2
    assert sorted(seen) == sorted(2 * [(block.azimuth_rad, block.elevation_rad) for block in overview.blocks])
    assert min(off_by(pose, each) for found in slices for each in found) < 8.0
    assert overview.found(image, poses, RANGE_M, Work(ENOUGH), ENOUGH) == []


@pytest.mark.parametrize(("sigma_m", "looks"), [(0.5, True), (0.2, False)])
def test_all_sides_are_looked_at_where_a_guess_may_be_off_by_a_view(candidates, sigma_m, looks):
    """Guesses that see the same views share them."""
    guesses = [motion(from_the(side)) for side in (1.0, 1.1, 2.0)]
    covariance = np.diag([sigma_m**2] * 3 + [sigma_m**2] * 3)
    candidates.begin()
    candidates.look_all_round(guesses, Sought(np.zeros((480, 640), np.uint8), [], covariance, RANGE_M))
    assert (candidates.all_round, candidates.looking) == (looks, looks)
    assert len(candidates.seen_from) == 2


def test_without_work_for_a_view_nothing_is_done(candidates):
    image = Scene([box_corners(SIZE)], seed=3).render(from_the(0.2), noise_rng=np.random.default_rng(0))
    poses, work = around(candidates, image, from_the(1.0)), Work(ENOUGH)
    assert candidates.overview.found(image, poses, RANGE_M, work, 500_000) == []
    assert work.done == 0 and not candidates.overview.is_complete(1)


def test_a_structure_that_does_not_fit_into_the_image_is_not_looked_at_from_all_sides(candidates):
    """Its other sides show parts of it that no shift brings into view."""
    assert candidates.overview.shows_all(motion(from_the(0.3, 0.4, 1.0)))
    assert not candidates.overview.shows_all(motion(from_the(0.3, 0.1, 0.35)))
