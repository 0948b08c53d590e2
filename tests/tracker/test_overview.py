"""After a loss poses from all sides of the guesses are looked at, in slices of frames, and none is passed over."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.ranking import Sought
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.scoring.rounds import Around
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.work import Work
from uavbench.trajectories.pose import Pose

ENOUGH = 10**12
STEP_NS = 66_666_667
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


@given(st.floats(-3.0, 3.0), st.floats(0.1, 0.3), st.floats(0.35, 2.0))
def test_a_guess_is_moved_back_until_the_whole_structure_fits_into_the_image(candidates, side_rad, height_m, range_m):
    """Of a part of it other sides show parts that no shift brings into view."""
    overview, pose = candidates.overview, from_the(side_rad, height_m, range_m)
    there = Pose(*overview.from_afar(motion(pose)))
    back_m = overview.back_m(motion(pose))
    before, middle = (each.transform(overview.middle[None])[0] for each in (pose, there))
    moved_m = there.inverse().translation - pose.inverse().translation
    np.testing.assert_allclose(np.cross(before, middle), 0.0, atol=1e-9)
    assert np.linalg.norm(moved_m) == pytest.approx(back_m, abs=1e-9)
    assert overview.back_m(motion(there)) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(there.rotation, pose.rotation)
    corners = CAMERA.project(there.transform(box_corners(SIZE)))
    assert (corners > 0).all() and (corners < np.array([CAMERA.width, CAMERA.height])).all()
    assert (back_m > 0.0) == (np.linalg.norm(before) < overview.least_range_m)


def lost(sigma_m):
    covariance = np.diag([sigma_m**2] * 6)
    return Sought(np.zeros((480, 640), np.uint8), [], covariance, RANGE_M, lost=True)


def test_of_searches_in_vain_near_a_structure_every_other_one_looks_from_as_far_back_as_it_may_be(candidates):
    near, looked = [motion(from_the(0.3, 0.1, 0.35))], []
    back_m = candidates.overview.back_m(near[0])
    candidates.begin_near()
    for sigma_m in (back_m + 0.2, back_m + 0.2, back_m + 0.2, back_m - 0.05, back_m - 0.05):
        candidates.begin()
        for _ in range(2):  # slices of a search are of one kind
            candidates.look_all_round(near, lost(sigma_m))
            looked.append(candidates.all_round)
    candidates.look_all_round(near, lost(back_m + 0.2)._replace(lost=False))
    assert looked == [True, True, False, False, True, True, False, False, False, False]
    assert candidates.searches == 0, "since a pose was accepted"


def test_a_search_that_begins_again_goes_on_with_the_views_that_are_left(candidates):
    """Frames far apart leave no time for all of them in one, and each begins a search."""
    candidates.begin_near()
    candidates.look_all_round([motion(from_the(0.3, 0.1, 0.35))], lost(1.0))
    candidates.overview.next_block = 7
    candidates.begin()
    assert candidates.overview.next_block == 7
    candidates.overview.next_block = len(candidates.overview.blocks)
    candidates.begin()
    assert candidates.overview.next_block == 0


PARTS = [
    box_corners((0.4, 0.3, 0.3)),
    box_corners((0.12, 0.1, 0.4), (0.3, 0.18)),
    box_corners((0.1, 0.14, 0.15), (-0.28, 0.12)),
]


def near_side(angle_deg):
    angle = np.radians(angle_deg)
    return look_at(np.array([0.8 * np.cos(angle), 0.8 * np.sin(angle), 0.5]), (0.0, 0.0, 0.15))


def test_a_structure_larger_than_the_image_is_found_again_from_another_side():
    """It is lost for 3 s, while the camera goes round it by 55 degrees so close that never all of it is in view."""
    structure = Structure.from_mesh(
        np.concatenate(PARTS), np.concatenate([BOX_TRIANGLES + 8 * k for k in range(len(PARTS))])
    )
    scene, rng = Scene(PARTS, seed=1), np.random.default_rng(1)
    run = Robust().start(structure, CAMERA, near_side(70.0), np.random.default_rng(0))
    back = np.linspace(25.0, 28.0, 30)
    found = []
    for k, angle in enumerate([*np.linspace(70.0, 80.0, 20), *[None] * 45, *back]):
        pose = None if angle is None else near_side(angle)
        shown = scene.render(pose, noise_rng=rng) if pose else rng.integers(100, 140, (480, 640, 3)).astype(np.uint8)
        result = run.track(shown, k * STEP_NS)
        if pose is not None and result.status == "ok":
            off_m = result.cam_from_world.inverse().translation - pose.inverse().translation
            found.append((k, float(np.linalg.norm(off_m))))
    assert max(off_m for _, off_m in found) < 0.02
    assert sum(k >= 65 for k, _ in found) >= 10
