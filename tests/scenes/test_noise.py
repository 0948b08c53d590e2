"""Seeded noise images do what they say: by measurement."""

from collections.abc import Callable

import numpy as np
import pytest

from uavbench.scenes.materials import procedural_texture as noise


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


def mean_power(made: Callable[[np.random.Generator], noise.Image], draws: int = 150) -> np.ndarray:
    """Power of each frequency (h, w), on average over draws, as a share of the whole."""
    power = np.mean([np.abs(np.fft.fft2(made(np.random.default_rng(k)))) ** 2 for k in range(draws)], axis=0)
    return np.asarray(power / power.sum())


def expected_power(shape: tuple[int, int], octaves: list[tuple[float, float, float]]) -> np.ndarray:
    """The sum of Gaussian spectra (height, size along y, along x), as a share of the whole.

    Heights are those of the half of a spectrum that is drawn: kx >= 0.
    """
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None]
    whole = np.zeros(shape)
    for height, sy, sx in octaves:
        one = np.exp(-(np.pi**2) * ((fy * sy) ** 2 + (fx * sx) ** 2))
        one[0, 0] = 0
        whole += height**2 * one / one[:, fx[0] >= 0].sum()
    return whole / whole.sum()


@pytest.mark.parametrize(
    ("made", "octaves"),
    [
        (lambda rng: noise.tiling((96, 80), (6, 4), rng), [(1.0, 6, 4)]),
        (lambda rng: noise.tiling((96, 80), 5, rng), [(1.0, 5, 5)]),
        (lambda rng: noise.fractal((96, 80), 12, rng, octaves=2, gain=0.5), [(1.0, 12, 12), (0.5, 6, 6)]),
        (lambda rng: noise.fractal((96, 80), 24, rng), [(0.6**k, 24 / 2**k, 24 / 2**k) for k in range(5)]),
    ],
)
def test_every_frequency_has_the_power_of_its_octaves(
    made: Callable[[np.random.Generator], noise.Image], octaves: list[tuple[float, float, float]]
) -> None:
    """In rings from low to high, and along each axis, where only the real part of some is drawn."""
    found, expected = mean_power(made), expected_power((96, 80), octaves)
    size = octaves[-1][2]
    along_y, along_x = np.abs(np.fft.fftfreq(96))[:, None], np.abs(np.fft.fftfreq(80))[None]
    ring = np.floor(np.hypot(along_y, along_x) * octaves[0][2] * 4).astype(int)
    shares = [[power[ring == k].sum() for k in range(12)] for power in (found, expected)]
    assert shares[0] == pytest.approx(shares[1], rel=0.12, abs=0.002)
    for axis in (0, 1):
        on_axis = [power.take(0, axis=axis).sum() for power in (found, expected)]
        assert on_axis[0] == pytest.approx(on_axis[1], rel=0.1)
    assert found[0, 0] < 1e-9
    beyond = np.maximum(along_y, along_x) * size > 1.2
    assert found[beyond].sum() < 1e-4


def test_noise_finer_than_its_pixels_has_all_frequencies() -> None:
    """Rows of the spectrum up to the highest frequency, which is there once where the height is even; and columns."""
    for shape in ((8, 11), (9, 7)):
        found = mean_power(lambda rng, shape=shape: noise.tiling(shape, 0.5, rng), draws=400)  # type: ignore[misc]
        expected = expected_power(shape, [(1.0, 0.5, 0.5)])
        for axis in (0, 1):
            assert found.sum(axis=axis) == pytest.approx(expected.sum(axis=axis), rel=0.3)


def test_fractal_noise_has_five_octaves_of_a_gain_of_six_tenths() -> None:
    assert noise.fractal((32, 32), 24, rng()).tolist() == noise.fractal((32, 32), 24, rng(), 5, 0.6).tolist()


def test_noise_finer_than_its_pixels_and_images_of_one_row_are_whole() -> None:
    for shape in ((1, 64), (64, 1), (5, 7)):
        image = noise.tiling(shape, 0.5, rng())
        assert image.shape == shape
        assert image.dtype == np.float32
        assert float(image.mean()) == pytest.approx(0.0, abs=1e-5)
        assert float(image.std()) == pytest.approx(1.0, abs=1e-4)


def test_a_blur_spreads_a_point_over_its_deviation() -> None:
    point = np.zeros((41, 41), dtype=np.float32)
    point[20, 20] = 1.0
    wide = noise.blurred(point, 3.0)
    assert wide.dtype == np.float32
    assert float(wide.sum()) == pytest.approx(1.0, abs=1e-4)
    for axis in (0, 1):
        assert float((wide.sum(axis=axis) * (np.arange(41) - 20.0) ** 2).sum()) == pytest.approx(9.0, rel=0.02)


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


def test_the_noise_of_a_seed_stays_what_scenes_were_rendered_with() -> None:
    """Its law leaves open which draw is which frequency's, and how many are drawn: as it was first."""
    image = noise.fractal((12, 16), 9, np.random.default_rng(0), octaves=2)
    assert image[:2, :5].ravel().tolist() == pytest.approx(
        [-0.70203, -0.12496, 0.34339, 0.65458, 0.83598, -0.22658, 0.19810, 0.53318, 0.75934, 0.91334], abs=1e-4
    )
