"""The blur of an image is measured by edges that stand alone, and steps are fitted with it."""

import numpy as np
import pytest

from tests.tracker.lit_edge import SRGB, appearance, edge
from uavbench.tracker.robust.edges.steps.blur_kernels import LEAST_MEASURED, excess_blur
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, FIRST_BLUR_PX, PIXEL_PX, Optics
from uavbench.tracker.robust.optics.blur import MOST_BLUR_PX, Blur


def excess(image, lines, distance, blur_px, learned=True):
    n = len(lines.lines)
    at = np.broadcast_to(distance, n).astype(float)
    return excess_blur.for_python(
        image, lines, np.arange(n), appearance(lines, learned), at, Optics(SRGB[None], blur_px, ALIGNED)
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
