"""A run that lost its pose finds it again by what it saw before, wherever the camera went meanwhile."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, look_at, pose_error
from uavbench.scenes.camera import Camera
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.places.descriptor_kernels import nearest_two
from uavbench.tracker.robust.places.features import (
    MOST_LANDMARKS,
    Features,
    Landmarks,
    features_of,
    landmarks_of,
    matched,
)
from uavbench.tracker.robust.places.match_kernels import HYPOTHESES, SAMPLE, pose_of_matches
from uavbench.tracker.robust.places.places import MOST_PLACES, Places
from uavbench.tracker.robust.preprocessing.small_images import grey, small_image
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.robust.work import FEATURES, Work, recall_evaluations
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
TARGET = (0.0, 0.0, 0.15)
EDGES = EdgeMap.of(box(), RobustConfig().edges.sampling.rounded_deg)
LENSES = [
    CAMERA,
    replace(CAMERA, distortion_model="radtan", distortion=(-0.2, 0.05, 0.001, 0.0)),
    replace(CAMERA, distortion_model="equidistant", distortion=(-0.02, 0.01, 0.0, 0.0)),
]
RESERVE = 2_300_000
"""Work of two fits."""
ENOUGH = 100 * (2 * FEATURES + recall_evaluations(MOST_LANDMARKS))
"""Work that allows all that is wanted."""


def seen_from(degrees, range_m=1.2, height_m=0.7):
    """The camera on a circle about the box."""
    angle = np.radians(degrees)
    return contiguous(look_at(np.array([range_m * np.cos(angle), range_m * np.sin(angle), height_m]), TARGET))


def contiguous(pose):
    return Pose(np.ascontiguousarray(pose.rotation), np.ascontiguousarray(pose.translation))


def turned(pose, *degrees):
    """A camera turned in place about its own axes."""
    return contiguous(Pose.exp(np.array([0.0, 0.0, 0.0, *np.radians(degrees)])) @ pose)


@pytest.fixture(scope="module")
def scene():
    return Scene([box_corners()], seed=3)


def places(seed=0, step=0.16):
    return Places(EDGES, CAMERA, step, np.random.default_rng(seed))


def grey_of(scene, pose):
    return np.ascontiguousarray(scene.render(pose)[..., 1])


def matches(rng, true, right, wrong, noise):
    """Points and where they are seen: right ones with noise, and wrong ones; the best are not always the first."""
    points = rng.uniform(-1, 1, (right + wrong, 3))
    cam = true.transform(points)
    seen = cam[:, :2] / cam[:, 2:] + rng.normal(scale=noise, size=(right + wrong, 2))
    seen[rng.permutation(right + wrong)[:wrong]] = rng.uniform(-0.5, 0.5, (wrong, 2))
    return points, seen


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), turn_deg=st.floats(0, 25), shift=st.floats(0, 1.0))
def test_the_pose_of_matches_is_the_true_one_if_half_are_right(seed, turn_deg, shift):
    rng = np.random.default_rng(seed)
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    start = Pose(np.eye(3), np.array([0.0, 0.0, 4.0]))
    true = Pose.exp(np.concatenate([shift * way, np.radians(turn_deg) * axis])) @ start
    points, seen = matches(rng, true, 90, 90, 0.001)
    samples = rng.random((HYPOTHESES, SAMPLE))
    found = pose_of_matches(points, seen, start.rotation, start.translation, samples, 0.008)
    error = pose_error(Pose(found.R, found.t), true)
    # 90 points of 1 milliradian: 4 m * 0.001 / sqrt(90) = 0.4 mm across, and some four times as much along the sight
    assert error.distance_m < 0.02
    assert error.angle_rad < 0.005
    assert found.cost < 95  # 90 wrong ones, and what the noise of the others costs


@pytest.mark.parametrize("kind", ["none right", "on a line", "one point", "behind the camera"])
def test_matches_that_tell_no_pose_give_a_finite_one_or_infinite_cost(kind):
    rng = np.random.default_rng(1)
    points, seen = rng.uniform(-1, 1, (30, 3)), rng.uniform(-0.5, 0.5, (30, 2))
    start = np.array([0.0, 0.0, -4.0 if kind == "behind the camera" else 4.0])
    if kind == "on a line":
        points = np.outer(np.linspace(-1, 1, 30), [1.0, 0.5, 0.2])
    if kind == "one point":
        points, seen = np.repeat(points[:1], 30, axis=0), np.repeat(seen[:1], 30, axis=0)
    found = pose_of_matches(points, seen, np.eye(3), start, rng.random((HYPOTHESES, SAMPLE)), 0.008)
    assert not np.isnan(found.cost)
    assert np.isinf(found.cost) or (np.isfinite(found.R).all() and np.isfinite(found.t).all())


def test_landmarks_lie_on_the_structure_where_they_are_seen(scene):
    pose = seen_from(30)
    found = landmarks_of(grey_of(scene, pose), pose, CAMERA, EDGES)
    assert 20 < len(found.points) <= MOST_LANDMARKS
    low, high = box_corners().min(axis=0), box_corners().max(axis=0)
    distance = np.minimum(np.abs(found.points - low), np.abs(found.points - high)).min(axis=1)
    assert distance.max() < 1e-9
    assert ((found.points > low - 1e-9) & (found.points < high + 1e-9)).all()
    pixels = CAMERA.project(pose.transform(found.points))
    corners = features_of(grey_of(scene, pose), CAMERA).pixels
    assert np.linalg.norm(pixels[:, None] - corners[None], axis=2).min(axis=1).max() < 1e-6


def test_landmarks_are_matched_where_they_are_in_another_view(scene):
    here, there = seen_from(30), seen_from(34)
    landmarks = landmarks_of(grey_of(scene, here), here, CAMERA, EDGES)
    found = matched(landmarks, features_of(grey_of(scene, there), CAMERA), CAMERA)
    cam = there.transform(found.points)
    error_px = np.linalg.norm(cam[:, :2] / cam[:, 2:] - found.seen, axis=1) * CAMERA.fx
    assert len(found.points) >= 8
    assert np.median(error_px) < 4.0


def test_features_of_a_large_image_are_found_in_a_small_copy_at_their_pixels(scene):
    large = Camera.from_field_of_view(1920, 1440, 65.0)
    pose = seen_from(30)
    image = cv2.resize(scene.render(pose), (large.width, large.height), interpolation=cv2.INTER_CUBIC)
    small = grey(image)
    assert small.shape == (480, 640)
    found, at = landmarks_of(small, pose, large, EDGES), features_of(grey_of(scene, pose), CAMERA).pixels
    assert len(found.points) > 20
    pixels = CAMERA.project(pose.transform(found.points))
    assert np.median(np.linalg.norm(pixels[:, None] - at[None], axis=2).min(axis=1)) < 1.0


def test_a_place_keeps_its_image_when_the_caller_uses_the_buffer_again(scene):
    image = grey_of(scene, seen_from(30))
    known = places()
    known.add(image, seen_from(30), 1.2)
    before = known.places[0].image.copy()
    image[:] = 0
    assert (known.places[0].image == before).all() and before.any()


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.distortion_model)
def test_an_image_without_corners_has_no_features_and_no_matches(scene, camera):
    blank = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
    here = seen_from(30)
    landmarks = landmarks_of(grey_of(scene, here), here, CAMERA, EDGES)
    assert len(matched(landmarks, features_of(blank, camera), camera).points) == 0
    none = landmarks_of(blank, here, camera, EDGES)
    assert len(none.points) == 0
    assert len(matched(none, features_of(grey_of(scene, here), camera), camera).points) == 0


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.distortion_model)
def test_of_two_features_alike_neither_is_a_match(camera):
    look = np.random.default_rng(0).integers(0, 256, (1, 32), dtype=np.uint8)
    twins = Features(np.array([[10.0, 10.0], [90.0, 40.0]]), np.repeat(look, 2, axis=0))
    assert len(matched(Landmarks(np.zeros((1, 3)), look), twins, camera).points) == 0
    other = Features(twins.pixels, np.concatenate([look, ~look]))
    assert len(matched(Landmarks(np.zeros((1, 3)), look), other, camera).points) == 1


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 40), others=st.integers(2, 40), alike=st.booleans())
def test_the_nearest_two_descriptors_are_those_of_opencv(seed, count, others, alike):
    rng = np.random.default_rng(seed)
    a, b = (rng.integers(0, 256, (n, 32), dtype=np.uint8) for n in (count, others))
    if alike:
        b[rng.integers(others)] = a[0]
        b[rng.integers(others)] = ~a[-1]
    found = nearest_two(a.view(np.uint64), np.ascontiguousarray(b.view(np.uint64).T))
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(a, b, k=2)
    assert found.first.tolist() == [best.distance for best, _ in pairs]
    assert found.second.tolist() == [second.distance for _, second in pairs]
    assert found.row.tolist() == [best.trainIdx for best, _ in pairs]


@pytest.mark.parametrize("change", [(0, 20, 0), (0, -25, 0), (12, 0, 0), (0, 0, 30)], ids=str)
def test_a_camera_that_turned_in_place_is_recalled(scene, change):
    here = seen_from(30)
    there = turned(here, *change)
    known = places()
    known.add(grey_of(scene, here), here, 1.2)
    found = known.recalled(grey_of(scene, there), Work(ENOUGH), 0)
    assert pose_error(found.landmarks[0], there).angle_rad < 0.03
    assert pose_error(found.landmarks[0], there).distance_m < 0.05


def test_the_place_that_looks_most_like_the_image_is_among_the_guesses(scene):
    known = places()
    for degrees in range(0, 180, 30):
        known.add(grey_of(scene, seen_from(degrees)), seen_from(degrees), 1.2)
    found = known.recalled(grey_of(scene, seen_from(62)), Work(ENOUGH), 0)
    assert pose_error(found.alike[0], seen_from(60)).distance_m < 1e-9
    assert pose_error(found.landmarks[0], seen_from(62)).distance_m < 0.03


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_places_are_a_step_apart_and_no_pose_is_far_from_all_of_them(seed):
    rng = np.random.default_rng(seed)
    known, image = places(), np.zeros((12, 16), np.uint8)
    walk = np.cumsum(rng.normal(scale=0.15, size=(400, 3)), axis=0)
    poses = [Pose(np.eye(3), -centre) for centre in walk]
    for pose in poses:
        known.add(image, pose, 1.0)
    centres = np.array([place.pose.inverse().translation for place in known.places])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)[~np.eye(len(centres), dtype=bool)]
    assert 1 < len(centres) <= MOST_PLACES
    assert apart.min() > known.apart >= known.step
    nearest = np.linalg.norm(walk[:, None] - centres[None], axis=2).min(axis=1)
    assert nearest.max() <= 2 * known.apart  # thinned out at most once by each doubling


def test_the_last_place_is_where_the_run_was_last_and_not_the_newest():
    known, image = places(), np.zeros((12, 16), np.uint8)
    for x in (0.0, 0.5, 1.0, 0.5, 0.02):
        known.add(image, Pose(np.eye(3), np.array([x, 0.0, 0.0])), 1.0)
    assert known.last is known.places[0]


def test_a_camera_that_only_turns_makes_places_too():
    known, image = places(), np.zeros((12, 16), np.uint8)
    for degrees in range(0, 61, 5):
        known.add(image, turned(seen_from(0), 0, degrees, 0), 1.0)
    assert len(known.places) == 7  # every ten degrees: 0.16 rad are 9.2


@pytest.mark.parametrize("allowed", [0, FEATURES, 7_000_000, 20_000_000, ENOUGH])
def test_work_is_within_what_is_allowed_and_little_work_is_spent_in_every_second_frame(scene, allowed):
    known = places()
    for degrees in (0, 20, 40):
        known.add(grey_of(scene, seen_from(degrees)), seen_from(degrees), 1.2)
    image = grey_of(scene, seen_from(42))
    spent, found = [], []
    for _ in range(6):
        work = Work(allowed)
        found.append(known.recalled(image, work, RESERVE))
        spent.append(work.done)
    assert max(spent) <= max(allowed // 2, allowed - RESERVE, 0)
    assert max(spent) <= allowed // 2 or min(spent[0::2]) == 0 or min(spent[1::2]) == 0
    assert max(spent) >= FEATURES or allowed <= FEATURES
    if allowed >= 7_000_000:
        likely = [*found[4].landmarks, *found[4].alike]
        assert pose_error(likely[0], seen_from(42)).distance_m < 0.05


def test_with_little_work_each_likely_place_has_its_turn_not_only_the_last(scene):
    """Of a structure that comes back into view elsewhere the last place shows another side."""
    known = places()
    for degrees in (20, 110, 200):
        known.add(grey_of(scene, seen_from(degrees)), seen_from(degrees), 1.2)
    there = turned(seen_from(20), 0, 12, 0)
    found = [known.recalled(grey_of(scene, there), Work(6_000_000), 1_000_000) for _ in range(16)]
    right = [any(pose_error(pose, there).distance_m < 0.02 for pose in recalled.landmarks) for recalled in found]
    assert any(right), right


def test_small_images_do_not_tell_exposure_and_a_blank_one_tells_nothing(scene):
    image = grey_of(scene, seen_from(30))
    darker = (image * 0.5 + 20).astype(np.uint8)
    assert small_image(image) @ small_image(darker) > 0.999
    assert small_image(image) @ small_image(grey_of(scene, seen_from(120))) < 0.95
    for level in range(0, 256, 7):
        assert np.abs(small_image(np.full((47, 65), level, np.uint8))).max() < 1e-5


@pytest.mark.parametrize("turn", [(0, 24, 0), (0, 20, 20), (0, 0, 35)], ids=str)
def test_after_some_blank_frames_the_camera_is_found_where_it_turned(scene, turn):
    """Farther than any search of edges looks: without places none of these is found."""
    there = turned(seen_from(30), *turn)
    rng = np.random.default_rng(0)
    run = Robust().start(box(), CAMERA, seen_from(20), np.random.default_rng(0))
    stamp = 0
    for degrees in np.arange(20, 31, 0.5):
        result = run.track(scene.render(seen_from(degrees), noise_rng=rng), stamp)
        assert result.status == "ok"
        stamp += STEP_NS
    for _ in range(15):
        run.track(np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8), stamp)
        stamp += STEP_NS
    statuses = []
    for _ in range(12):
        result = run.track(scene.render(there, noise_rng=rng), stamp)
        statuses.append(result.status)
        stamp += STEP_NS
        if result.status == "ok":
            assert pose_error(result.cam_from_world, there).distance_m < 0.01
    assert statuses[-1] == "ok"


def test_a_structure_that_is_not_there_is_not_recalled(scene):
    run = Robust().start(box(), CAMERA, seen_from(20), np.random.default_rng(0))
    rng, stamp = np.random.default_rng(0), 0
    for degrees in np.arange(20, 26, 0.5):
        run.track(scene.render(seen_from(degrees), noise_rng=rng), stamp)
        stamp += STEP_NS
    other = Scene([box_corners((0.9, 0.12, 0.5))], seed=9)
    assert run.decider.places.places
    for degrees in np.arange(40, 46, 0.5):
        assert run.track(other.render(seen_from(degrees), noise_rng=rng), stamp).status != "ok"
        stamp += STEP_NS


def test_an_empty_structure_has_no_landmarks(scene):
    far = Structure.from_mesh(box_corners(centre=(50.0, 50.0)), np.array([[0, 2, 1]]))
    here = seen_from(30)
    edges = EdgeMap.of(far, RobustConfig().edges.sampling.rounded_deg)
    assert len(landmarks_of(grey_of(scene, here), here, CAMERA, edges).points) == 0
