"""Statistics of images whose statistics are known."""

import numpy as np
import pytest

from uavbench.bench.gallery.natural_statistics import NaturalStatistics, kurtosis, spectrum_slope


def noise_of_slope(slope: float, seed: int = 0) -> np.ndarray:
    """An image (256, 320) whose power falls by this slope."""
    shape = (256, 320)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(shape[0]), np.fft.fftfreq(shape[1]), indexing="ij"))
    frequency[0, 0] = 1.0
    white = np.fft.fft2(np.random.default_rng(seed).standard_normal(shape))
    return np.fft.ifft2(white * frequency ** (slope / 2)).real


@pytest.mark.parametrize("slope", [0.0, -1.0, -2.0, -3.0])
def test_the_slope_is_that_of_the_spectrum(slope: float) -> None:
    assert spectrum_slope(noise_of_slope(slope)) == pytest.approx(slope, abs=0.2)


def test_kurtosis_of_known_distributions() -> None:
    rng = np.random.default_rng(0)
    assert kurtosis(rng.standard_normal(200000)) == pytest.approx(3.0, abs=0.05)
    assert kurtosis(rng.laplace(size=200000)) == pytest.approx(6.0, abs=0.3)


def test_the_deviation_is_that_of_log_light() -> None:
    """Half of the image twice as bright as the other: half of log 2."""
    codes = np.zeros((64, 64, 3), dtype=np.uint8)
    codes[:, :32], codes[:, 32:] = 128, 176  # 0.2158 and 0.4342 in linear light (IEC 61966-2-1)
    assert NaturalStatistics.of(codes).log_deviation == pytest.approx(np.log(0.4342 / 0.2158) / 2, rel=1e-3)
