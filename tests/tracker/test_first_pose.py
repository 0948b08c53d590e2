"""The first pose: in images that do not show the structure, so that none is right, in the dark, and far away."""

import cv2
import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, Scene, box, box_corners, flown, orbit, pose_error
from uavbench.tracker.robust.tracker import Robust
from uavbench.trajectories.pose import Pose

STEP_NS = 66_666_667
FRAMES = 12
WIDTH, HEIGHT = CAMERA.width, CAMERA.height


def seen(drawn, rng):
    """Frames of a drawing that the camera passes, with noise."""
    frames = []
    for i in range(FRAMES):
        moved = cv2.warpAffine(drawn, np.array([[1.0, 0, 2 * i], [0, 1.0, i]]), (WIDTH, HEIGHT), borderMode=1)
        frames.append(np.clip(moved + rng.normal(0, 3, moved.shape), 0, 255).astype(np.uint8))
    return frames


def bars(rng, number):
    """Straight bars of all lights, as of a lattice."""
    drawn = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    for _ in range(number):
        (x0, x1), (y0, y1) = rng.uniform(-100, WIDTH + 100, 2), rng.uniform(-100, HEIGHT + 100, 2)
        light = [int(rng.integers(30, 220))] * 3
        cv2.line(drawn, (int(x0), int(y0)), (int(x1), int(y1)), light, int(rng.integers(4, 40)), cv2.LINE_AA)
    return seen(drawn, rng)


def panels(rng, number):
    """A row of panels of all lights above another, seen at a slant."""
    drawn, wide, high = np.full((HEIGHT, WIDTH, 3), 110, np.uint8), WIDTH / number, HEIGHT / (number - 1)
    for i, j in np.ndindex(number, number - 1):
        corner, light = np.array([wide * (i + 0.15), high * (j + 0.15)]), [int(rng.integers(40, 220))] * 3
        cv2.rectangle(drawn, corner.astype(int), (corner + 0.7 * np.array([wide, high])).astype(int), light, -1)
    slant = np.eye(3) + rng.normal(0, 1, (3, 3)) * [[0.15, 0.15, 20], [0.15, 0.15, 20], [2e-4, 2e-4, 0]]
    return seen(cv2.warpPerspective(drawn, slant, (WIDTH, HEIGHT), borderMode=1), rng)


def taken(frames):
    """Whether the box is found in any of the frames."""
    (first, *_), _ = flown(1, seed=11)
    run = Robust().start(box(), CAMERA, first, np.random.default_rng(0))
    return any(run.track(image, i * STEP_NS).status == "ok" for i, image in enumerate(frames))


@pytest.mark.parametrize("number", [8, 16])
def test_bars_are_not_taken_for_the_structure(number):
    assert not any(taken(bars(np.random.default_rng(seed), number)) for seed in range(6))


def test_panels_are_not_taken_for_the_structure_unless_one_has_the_proportions_of_a_face():
    found = [taken(panels(np.random.default_rng(seed), number)) for number in (3, 4) for seed in range(14)]
    assert np.count_nonzero(found) <= 2


@pytest.mark.parametrize(("seed", "contrast", "noise_grey"), [(3, 1.0, 27.0), (2, 0.7, 20.0), (24, 1.0, 30.0)])
def test_a_right_initial_pose_is_kept_in_the_dark(seed, contrast, noise_grey):
    """A fourth of the points is found there, less than of any usual frame, but far more than by chance."""
    poses, images = flown(4, seed=seed)
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    noise = np.random.default_rng(seed)
    for i, (pose, image) in enumerate(zip(poses, images, strict=True)):
        dark = 128.0 + contrast * (image.astype(np.float64) - 128.0) + noise.normal(0.0, noise_grey, image.shape)
        result = run.track(dark.clip(0, 255).round().astype(np.uint8), i * 66_666_667)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, pose)[0] < 0.02


@pytest.mark.parametrize(("range_m", "seed"), [(2.0, 3), (3.2, 5)])
def test_a_pose_that_a_small_structure_tells_too_little_of_is_followed_while_it_is_doubted(range_m, seed):
    """Otherwise the camera leaves the initial pose, about which it is sought, before it has seen more."""
    poses = orbit(16, seed=seed, range_m=range_m, speed_m_s=0.5)
    scene, noise = Scene([box_corners()], seed=seed), np.random.default_rng(seed)
    away = Pose.exp([0.03 * range_m, -0.02 * range_m, 0.03 * range_m, 0.04, -0.05, 0.03])
    run = Robust().start(box(), CAMERA, away @ poses[0], np.random.default_rng(0))
    results = [run.track(scene.render(pose, noise_rng=noise), i * STEP_NS) for i, pose in enumerate(poses)]
    assert [result.status for result in results[2:]] == ["ambiguous"] * (len(poses) - 2)
    assert pose_error(results[-1].guess, poses[-1])[0] < range_m / 60
