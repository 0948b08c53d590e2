"""A pose is aligned to where an image shows the surface as it was seen, and a lost one is found by that."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at, pose_error
from uavbench.scenes.camera import Camera
from uavbench.tracker.geometry_kernels import RigidMotion
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.places.places import Places
from uavbench.tracker.robust.relocalization.pose_arrays import motion
from uavbench.tracker.robust.relocalization.relocate import Relocator
from uavbench.tracker.robust.relocalization.scoring.pose_search_kernels import turned_about
from uavbench.tracker.robust.relocalization.surfaces.aligner import REMEMBERED, SHADES, Aligner, rarity
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.work import Work
from uavbench.trajectories.pose import Pose

ENOUGH = 10**12
MIDDLE = (0.0, 0.0, 0.15)
RANGE_M = 1.4
STEP_NS = 66_666_667


def seen_from(side_rad, height_m=0.6):
    """The camera on a circle about the box."""
    across = math.sqrt(RANGE_M**2 - height_m**2)
    return look_at(np.array([across * math.cos(side_rad), across * math.sin(side_rad), height_m]), MIDDLE)


def aligner_of(camera: Camera = CAMERA) -> Aligner:
    return Relocator(EdgeFitter(box(), camera, np.random.default_rng(0), RobustConfig()), camera).candidates.aligner


@pytest.fixture(scope="module")
def scene():
    return Scene([box_corners()], seed=3)


@pytest.fixture(scope="module")
def aligner():
    return aligner_of()


def looked_at(aligner, scene, *sides_rad):
    """Surfaces as seen from some sides of the box."""
    return [aligner.reader.surface(scene.render(pose), pose) for pose in map(seen_from, sides_rad)]


def beside(aligner, pose, k, px=8.0):
    """The k-th pose about another, whose edges lie by about so many px of the small image beside."""
    there = motion(pose)
    focus = there.R @ np.array(MIDDLE) + there.t
    change = np.random.default_rng(k).uniform(-1.0, 1.0, 6)
    return turned_about(*there, focus, change / np.linalg.norm(change) * aligner.searcher.steps * px / 5.0)


def error(found: RigidMotion, pose):
    """Errors of a pose, m and degrees."""
    distance_m, angle_rad = pose_error(Pose(found.R, found.t), pose)
    return distance_m, math.degrees(angle_rad)


def test_points_of_a_surface_lie_on_the_structure_where_they_are_seen(aligner, scene):
    pose = seen_from(0.4)
    (surface,) = looked_at(aligner, scene, 0.4)
    low, high = box_corners().min(axis=0), box_corners().max(axis=0)
    beside_a_face = np.minimum(np.abs(surface.points - low), np.abs(surface.points - high)).min(axis=1)
    assert beside_a_face.max() < 1e-9
    assert ((surface.points > low - 1e-9) & (surface.points < high + 1e-9)).all()
    toward = -pose.rotation.T @ pose.translation - surface.points
    assert (np.einsum("ij,ij->i", toward, surface.normals) > 0.0).all()
    assert len(surface.points) > 150


@pytest.mark.parametrize("k", range(8))
def test_a_pose_beside_the_true_one_is_aligned_to_it(aligner, scene, k):
    pose = seen_from(0.55)
    aligner.look(scene.render(pose), looked_at(aligner, scene, 0.4), Work(ENOUGH))
    found = aligner.aligned(beside(aligner, pose, k), Work(ENOUGH))
    distance_m, angle_deg = error(found.pose, pose)
    assert distance_m < 0.03 * RANGE_M
    assert angle_deg < 1.5
    assert found.rarity > REMEMBERED


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 10.0), (0.7, 60.0)])
def test_the_light_may_be_another_one(aligner, scene, gain, offset):
    pose = seen_from(0.5)
    image = (gain * scene.render(pose).astype(np.float64) + offset).astype(np.uint8)
    aligner.look(image, looked_at(aligner, scene, 0.4), Work(ENOUGH))
    found = aligner.aligned(beside(aligner, pose, 1, px=5.0), Work(ENOUGH))
    assert error(found.pose, pose)[1] < 1.5
    assert found.rarity > REMEMBERED


def test_what_is_masked_tells_nothing(scene):
    corner = ((0.0, 0.0), (0.4 * CAMERA.width, 0.0), (0.4 * CAMERA.width, CAMERA.height), (0.0, CAMERA.height))
    camera, pose = replace(CAMERA, masked=(corner,)), seen_from(0.5)
    aligner = aligner_of(camera)
    surfaces, guess = looked_at(aligner, scene, 0.4), beside(aligner, pose, 2, px=4.0)
    found = []
    for value in (0, 255):
        image = scene.render(pose)
        image[~camera.unmasked] = value
        aligner.look(image, surfaces, Work(ENOUGH))
        found.append(aligner.aligned(guess, Work(ENOUGH)))
    assert found[0].rarity == found[1].rarity
    assert np.array_equal(found[0].pose.R, found[1].pose.R)


def test_of_several_surfaces_that_seen_from_the_nearest_direction_is_taken(aligner, scene):
    sides = (0.0, 0.9, 1.8, 4.0)
    aligner.look(scene.render(seen_from(0.0)), looked_at(aligner, scene, *sides), Work(ENOUGH))
    assert [aligner.nearest(motion(seen_from(side + 0.2))) for side in sides] == [0, 1, 2, 3]


@pytest.mark.parametrize("away_deg", [-55, -35, 40, 60])
def test_a_pose_far_from_the_guess_is_found_in_one_look(aligner, scene, away_deg):
    pose, guess = seen_from(1.0), seen_from(1.0 + np.radians(away_deg))
    aligner.look(scene.render(pose), looked_at(aligner, scene, 0.8, 1.0 + np.radians(away_deg)), Work(ENOUGH))
    aligner.begin()
    found = aligner.found([motion(guess)], lambda _: 0.0, Work(ENOUGH))
    assert min(error(each, pose)[1] for each in found) < 3.0


def test_work_stays_within_what_is_left_for_an_alignment(aligner, scene):
    aligner.look(scene.render(seen_from(0.5)), looked_at(aligner, scene, 0.4), Work(ENOUGH))
    for k in range(10):
        work = Work(ENOUGH)
        aligner.aligned(beside(aligner, seen_from(0.5), k), work)
        assert 0 < work.done <= aligner.most


@pytest.mark.parametrize("part", [0.25, 1.0])
def test_rarity_is_the_likelihood_ratio_of_normal_samples(part):
    """-n/2 log10(1 - r^2) of n samples: from the determinant of their correlation matrix."""
    determinant = np.linalg.det([[1.0, 0.9], [0.9, 1.0]])
    assert rarity(0.9, part) == pytest.approx(-0.5 * SHADES * part * np.log10(determinant))
    assert rarity(-0.9, part) == rarity(0.0, part) == 0.0
    assert math.isfinite(rarity(1.0, part))


def test_surfaces_are_read_once_each_as_far_as_the_work_allows(scene):
    fitter = EdgeFitter(box(), CAMERA, np.random.default_rng(0), RobustConfig())
    places = Places(fitter.edges, CAMERA, 0.16, np.random.default_rng(0))
    for side in (0.0, 0.5, 1.0):
        pose = seen_from(side)
        places.add(np.ascontiguousarray(scene.render(pose)[..., 1]), pose, RANGE_M)
    reader = Relocator(fitter, CAMERA).reader
    assert places.surfaces(reader, Work(100_000)) == []
    assert len(places.surfaces(reader, Work(1_000_000))) == 2
    work = Work(ENOUGH)
    known = places.surfaces(reader, work)
    assert len(known) == 3
    assert np.allclose(known[0].t, seen_from(1.0).translation), "that of the last place"
    before = work.done
    assert places.surfaces(reader, work)[0] is known[0]
    assert work.done == before


@pytest.mark.parametrize("away_deg", [-60.0, 50.0])
def test_a_box_whose_other_side_came_into_view_is_found_at_once(scene, away_deg):
    """After two seconds in which nothing was seen; without surfaces it took eight frames, or was not found."""
    rng = np.random.default_rng(0)
    run = Robust().start(box(), CAMERA, seen_from(0.0), rng)
    stamps = iter(range(0, 100 * STEP_NS, STEP_NS))
    for k in range(20):
        run.track(scene.render(seen_from(0.02 * k), noise_rng=rng), next(stamps))
    for _ in range(30):
        run.track(rng.integers(100, 140, (CAMERA.height, CAMERA.width, 3)).astype(np.uint8), next(stamps))
    right = []
    for k in range(5):
        pose = seen_from(0.38 + math.radians(away_deg) + 0.01 * k)
        result = run.track(scene.render(pose, noise_rng=rng), next(stamps))
        if result.status == "ok":
            right.append(pose_error(result.cam_from_world, pose)[0] < 0.02)
    assert right
    assert all(right)
