"""A blurred step of light is found between the pixels, and the fit knows how well."""

import math

import numpy as np
import pytest

from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.edges.step_kernels import BLUR_PX, fit_step, learned_light

SIZE, FINE = 41, 8
DARK, BRIGHT = np.array([0.05, 0.08, 0.12]), np.array([0.5, 0.45, 0.4])


def edge(distance, angle_deg, noise=0.0, rng=None):
    """Image of a half plane that begins so many px beyond the middle along a normal: mixed light, sRGB codes."""
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    across = (at[None, :] - SIZE // 2) * nu + (at[:, None] - SIZE // 2) * nv - distance
    lens = math.sqrt(BLUR_PX**2 - 1 / 12)  # the rest of the blur is that of the pixels' area
    share = 0.5 * (1 + np.vectorize(math.erf)(across / (math.sqrt(2) * lens)))
    share = share.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None]
    codes = encode(DARK * (1 - share) + BRIGHT * share).astype(float)
    codes += rng.normal(0, noise, codes.shape) if rng is not None else 0.0
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), np.array([SIZE // 2, SIZE // 2, nu, nv], dtype=float)


def direction():
    row = np.zeros(8)
    row[:3], row[3:6], row[6] = encode(DARK[None, None])[0, 0], encode(BRIGHT[None, None])[0, 0], 5
    colour = np.empty(3)
    return learned_light(row, 3, colour), colour


@pytest.mark.parametrize("angle", [0, 20, 45, 70, 90, 135, 200, 310])
@pytest.mark.parametrize("distance", [-0.4, -0.1, 0.0, 0.3])
def test_a_step_is_found_to_a_hundredth_of_a_pixel(angle, distance):
    image, line = edge(distance, angle)
    _, colour = direction()
    found, variance = fit_step(image, line, 0.0, 3, 2, colour)
    assert found == pytest.approx(distance, abs=0.06)
    again, _ = fit_step(image, line, found, 3, 2, colour)
    assert again == pytest.approx(distance, abs=0.012)
    assert 0 < variance < 0.03**2


def test_its_variance_is_that_of_its_error():
    rng = np.random.default_rng(0)
    _, colour = direction()
    fits = []
    for _ in range(200):
        image, line = edge(0.1, rng.uniform(0, 360), 3.0, rng)
        fits.append(fit_step(image, line, 0.1, 3, 2, colour))
    found, variance = np.transpose(fits)
    assert 0.6 < np.mean((found - 0.1) ** 2 / variance) < 1.6


def test_no_step_is_found_where_there_is_none_or_it_goes_the_other_way():
    _, colour = direction()
    image, line = edge(0.0, 30)
    assert fit_step(np.full_like(image, 90), line, 0.0, 3, 2, colour)[0] == np.inf
    assert fit_step(image, line * np.array([1, 1, -1, -1]), 0.0, 3, 2, colour)[0] == np.inf
    assert fit_step(image, np.array([1.0, 1.0, 1.0, 0.0]), 0.0, 3, 2, colour)[0] == np.inf
