"""Seeded noise images do what they say: by measurement."""

import numpy as np
import pytest

from scenes import noise


def rng() -> np.random.Generator:
    return np.random.default_rng(8)


def test_noise_has_zero_mean_unit_deviation_and_its_feature_size_along_each_axis() -> None:
    """The autocorrelation of Gaussian noise of power exp(-(pi f s)^2) is exp(-(x / s)^2)."""
    image = noise.tiling((1024, 1024), (12, 5), rng())
    assert float(image.mean()) == pytest.approx(0.0, abs=1e-4)
    assert float(image.std()) == pytest.approx(1.0, abs=1e-3)
    for axis, size in ((0, 12), (1, 5)):
        for step in (size // 2, size, 2 * size):
            alike = float((image * np.roll(image, step, axis)).mean())
            assert alike == pytest.approx(np.exp(-((step / size) ** 2)), abs=0.03)


@pytest.mark.parametrize("shape", [(64, 96), (1, 300), (97, 61)])
def test_noise_goes_on_over_its_border(shape: tuple[int, int]) -> None:
    image = noise.fractal(shape, 40, rng(), octaves=2)
    for axis in (0, 1):
        if shape[axis] > 1:
            steps = np.abs(np.diff(image, axis=axis, append=image.take([0], axis)))
            assert steps.take(-1, axis).mean() < 2 * steps.mean()


def test_the_same_rng_gives_the_same_noise_at_any_size() -> None:
    """A texture drawn at twice the resolution is the same texture, finer."""
    small, large = (noise.tiling((n, n), n / 8, rng()) for n in (64, 128))
    assert np.corrcoef(small.ravel(), large[::2, ::2].ravel())[0, 1] > 0.999


def test_blend_and_paint_are_what_they_say() -> None:
    mask = np.array([[0.0, 0.25], [1.0, 0.5]], dtype=np.float32)
    under = noise.paint((10.0, 20.0, 30.0), np.ones((2, 2), dtype=np.float32))
    over = np.full((2, 2, 3), 50.0, dtype=np.float32)
    expected = under + (over - under) * mask[..., None]
    assert noise.blend(under, over, mask) == pytest.approx(expected)
    assert noise.blend(under, (50.0, 50.0, 50.0), mask) == pytest.approx(expected)
    assert noise.finish(np.array([[-3.0, 0.6], [254.4, 300.0]], dtype=np.float32)).tolist() == [[0, 1], [254, 255]]
