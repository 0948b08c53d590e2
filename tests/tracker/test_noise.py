"""The noise of a frame, and frames smoothed as their noise needs."""

import cv2
import numpy as np
import pytest

from uavbench.tracker.robust.config.preprocessing import PreprocessingConfig
from uavbench.tracker.robust.preprocessing.denoising import MEDIAN_TO_SIGMA, ROWS_APART, noise_level, smoothed

CONFIG = PreprocessingConfig()
ALLOWED = CONFIG.max_noise_grey


def scene(sigma, channels=3, seed=0):
    """A frame with edges and shading, and normal noise of a standard deviation in grey levels."""
    rng = np.random.default_rng(seed)
    image = np.full((480, 640, channels), 90.0) + np.linspace(0, 40, 640)[:, None]
    for _ in range(30):
        x, y = rng.integers(0, 560), rng.integers(0, 400)
        image[y : y + 80, x : x + 80] = rng.uniform(60, 190, channels)
    return np.clip(np.rint(image + rng.normal(0, sigma, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("sigma", [2.0, 6.0, 15.0, 30.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_noise_is_measured_beside_edges_and_shading(sigma, channels):
    assert noise_level(scene(sigma, channels)) == pytest.approx(sigma, rel=0.15)


@pytest.mark.parametrize("shape", [(33, 40, 3), (9, 41, 1), (2, 9, 1), (9, 2, 3)])
def test_noise_is_the_median_of_second_differences_along_both_axes(shape):
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    codes = image[:, :, 1 if shape[2] > 1 else 0].astype(int)
    across = np.abs(np.diff(np.diff(codes, 2, axis=0), 2, axis=1)[::ROWS_APART])
    median = np.sort(across, axis=None)[(across.size - 1) // 2] if across.size else 0
    assert noise_level(image) == MEDIAN_TO_SIGMA * median / 6.0


def test_a_frame_with_little_noise_stays_the_same():
    image = scene(0.8 * ALLOWED)
    assert smoothed(image, CONFIG) is image


@pytest.mark.parametrize("grey", [False, True])
def test_noise_is_smoothed_to_what_is_allowed(grey):
    image = scene(12.0)
    image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if grey else image
    smooth = smoothed(image, CONFIG)
    assert smooth.shape == image.shape
    assert smooth.dtype == np.uint8
    clean = scene(0.0)
    clean = cv2.cvtColor(clean, cv2.COLOR_BGR2GRAY) if grey else clean
    away = smooth.astype(float) - cv2.GaussianBlur(clean, (0, 0), 2.0)
    assert np.median(np.abs(away)) / 0.6745 < 1.3 * ALLOWED


def test_a_frame_of_a_single_row_is_left_as_it_is():
    row = np.zeros((1, 640, 3), np.uint8)
    assert smoothed(row, CONFIG) is row
