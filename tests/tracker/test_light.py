"""Light and exposure: images of little contrast, light that changes, and what robust makes of both."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown, pose_error
from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.tracker.robust.preprocessing.gain_offset import ContrastStretch, brightness_ratio
from uavbench.tracker.robust.tracker import Robust

CONFIG = PreprocessingConfig()

STEP_NS = 66_666_667


@pytest.fixture(scope="module")
def flight():
    """Poses and frames of 0.7 seconds around a box."""
    return flown(10, seed=12)


def dimmed(image, factor, base=0.0):
    return np.clip(np.round(base + factor * image.astype(float)), 0, 255).astype(np.uint8)


def test_a_change_of_light_is_measured_for_each_colour():
    rng = np.random.default_rng(0)
    image = rng.integers(60, 160, (40, 160, 3)).astype(np.uint8)
    brighter = np.round(image * np.array([1.0, 1.2, 1.5])).astype(np.uint8)
    assert brightness_ratio(brighter, image) == pytest.approx([1.0, 1.2, 1.5], abs=0.01)
    assert brightness_ratio(brighter[..., 1], image[..., 1]) == pytest.approx([1.2], abs=0.01)
    assert brightness_ratio(image, np.roll(image, 48, axis=1)) == pytest.approx([1.0, 1.0, 1.0], abs=0.03)
    assert (brightness_ratio(np.zeros_like(image), image) == 1).all()


def test_an_image_of_enough_contrast_stays_as_it_is():
    image = np.tile(np.arange(256, dtype=np.uint8), (64, 1))
    assert ContrastStretch.needed(image, CONFIG) == ContrastStretch()
    assert ContrastStretch().of(image) is image


@pytest.mark.parametrize("ratio", [1.0, 1.6])
def test_colours_follow_from_one_stretch_to_another(ratio):
    levels = np.arange(100, 121, dtype=np.uint8)
    one, two = ContrastStretch(4.0, 110.0), ContrastStretch(2.5, 110.0 * ratio)
    factor, offset = one.towards(two, np.array([ratio]))
    there = two.of(np.round(levels * ratio).astype(np.uint8)[None])[0]
    assert one.of(levels[None])[0] * factor[0] + offset[0] == pytest.approx(there, abs=4)


@pytest.mark.parametrize(
    "light",
    [
        pytest.param(lambda i: (0.15, 90.0), id="haze"),
        pytest.param(lambda i: (0.55 if i >= 5 else 1.0, 0.0), id="a cloud"),
        pytest.param(lambda i: (0.1 * 1.25**i, 0.0), id="the camera opens"),
    ],
)
def test_robust_follows_the_box_in_any_light(flight, light):
    poses, images = flight
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i, (pose, image) in enumerate(zip(poses, images, strict=True)):
        result = run.track(dimmed(image, *light(i)), i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, pose)[0] < 0.02


def test_a_dark_first_frame_does_not_decide_for_those_after_it(flight):
    poses, images = flight
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    assert run.track(np.zeros_like(images[0]), 0).status == "lost"
    for i in range(1, 5):
        result = run.track(images[i], i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.01


def test_the_light_of_a_view_that_is_lost_changes_nothing(flight):
    poses, images = flight
    run = Robust().start(box(), CAMERA, poses[0], np.random.default_rng(0))
    for i in range(3):
        run.track(images[i], i * STEP_NS)
    for i in range(3, 7):
        other = np.roll(dimmed(images[i], 0.4 + 0.1 * i), (200, 317), axis=(0, 1))[::-1]
        assert run.track(np.ascontiguousarray(other), i * STEP_NS).status == "lost"
    for i in range(7, 10):
        result = run.track(images[i], i * STEP_NS)
        assert result.status == "ok"
        assert pose_error(result.cam_from_world, poses[i])[0] < 0.01
