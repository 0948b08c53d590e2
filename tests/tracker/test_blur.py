"""The blur of an image is measured by edges that stand alone, and steps are fitted with it."""

import math

import numpy as np
import pytest
from scipy.special import erf

from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.steps.blur import MOST_BLUR_PX, Blur
from uavbench.tracker.robust.edges.steps.blur_kernels import LEAST_MEASURED, excess_blur
from uavbench.tracker.robust.edges.steps.optics_kernels import FIRST_BLUR_PX, PIXEL_PX, Optics
from uavbench.tracker.robust.fit.response import srgb_light

SIZE, FINE = 61, 8
SRGB = srgb_light(np.arange(256) / 255)
DARK, BRIGHT = np.array([0.05, 0.08, 0.12]), np.array([0.5, 0.45, 0.4])
CODES = np.concatenate([encode(DARK[None, None])[0, 0], encode(BRIGHT[None, None])[0, 0]]).astype(float)


def edge(blur_px, angle_deg, distance=0.0, noise=0.0, rng=None):
    """Image of a half plane by a lens, and the control points of its border, `distance` px before it."""
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    across = (at[None, :] - SIZE // 2) * nu + (at[:, None] - SIZE // 2) * nv
    lens = math.sqrt(max(blur_px**2 - 1 / 12, 1e-9))
    share = 0.5 * (1 + erf(across / (math.sqrt(2) * lens)))
    share = share.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None]
    codes = encode(DARK * (1 - share) + BRIGHT * share).astype(float)
    codes += rng.normal(0, noise, codes.shape) if rng is not None else 0.0
    along = np.arange(-18, 19, 6)
    n = len(along)
    pixels = np.full((n, 2), SIZE // 2) + along[:, None] * [-nv, nu] - distance * np.array([nu, nv])
    lines = np.column_stack([pixels, np.full(n, nu), np.full(n, nv)])
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), SearchLines(lines, np.zeros((n, 6)), np.ones(n, np.int64))


def excess(image, lines, distance, blur_px, learned=True):
    n = len(lines.lines)
    appearance = np.zeros((n, 8))
    appearance[:, :6], appearance[:, 6] = CODES, float(learned)
    return excess_blur.for_python(
        image, lines, np.arange(n), appearance, np.broadcast_to(distance, n).astype(float), Optics(SRGB[None], blur_px)
    )


@pytest.mark.parametrize("angle", [0, 17, 45, 80, 200])
@pytest.mark.parametrize("blur", [0.32, 0.5, 0.8, 1.2])
def test_the_blur_of_an_image_is_learned(blur, angle):
    image, lines = edge(blur, angle, distance=0.2)
    state = Blur()
    assert state.px == FIRST_BLUR_PX
    for _ in range(40):
        state.learn(excess(image, lines, 0.2, state.px), 0.1)
    assert state.px == pytest.approx(blur, rel=0.06, abs=0.03)


def test_a_step_found_a_little_beside_the_edge_tells_the_same_blur():
    image, lines = edge(0.7, 30)
    at, beside = (excess(image, lines, shift, 0.7) for shift in (0.0, 0.15))
    assert at == pytest.approx(0.0, abs=0.02)
    assert beside == pytest.approx(0.0, abs=0.04)


def test_noise_does_not_move_it():
    rng, state = np.random.default_rng(0), Blur()
    for _ in range(60):
        image, lines = edge(0.6, rng.uniform(0, 360), noise=3.0, rng=rng)
        state.learn(excess(image, lines, 0.0, state.px), 0.1)
    assert state.px == pytest.approx(0.6, rel=0.08)


def test_nothing_is_said_where_no_edge_is_alone_or_known():
    image, lines = edge(0.6, 30)
    assert np.isnan(excess(image, lines, np.inf, 0.5))
    assert np.isnan(excess(image, lines, 0.0, 0.5, learned=False))
    assert np.isnan(excess(np.full_like(image, 90), lines, 0.0, 0.5))
    few = np.where(np.arange(len(lines.lines)) < LEAST_MEASURED - 1, 0.0, np.inf)
    assert np.isnan(excess(image, lines, few, 0.5))


def test_a_frame_does_not_change_it_by_much_and_it_stays_in_bounds():
    state = Blur()
    state.learn(np.nan, 0.1)
    assert state.px == FIRST_BLUR_PX
    state.learn(100.0, 0.1)
    assert FIRST_BLUR_PX < state.px < 2 * FIRST_BLUR_PX
    for _ in range(200):
        state.learn(100.0, 0.1)
    assert state.px == MOST_BLUR_PX
    for _ in range(200):
        state.learn(-100.0, 0.1)
    assert state.px == pytest.approx(PIXEL_PX)
