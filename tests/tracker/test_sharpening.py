"""How much a camera sharpens is learned from the edges that stand alone, and undone where edges are located."""

import cv2
import numpy as np
import pytest

from tests.tracker.lit_edge import SRGB, appearance, edge
from uavbench.tracker.robust.edges.steps.blur_kernels import LEAST_MEASURED, excess_blur
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, BLOWN_OUT, Optics
from uavbench.tracker.robust.edges.steps.sharpening_kernels import Sharpened, excess_sharpening
from uavbench.tracker.robust.optics.blur import Blur
from uavbench.tracker.robust.optics.sharpening import ASK_EVERY, LEAST_AMOUNT, MOST_AMOUNT, Sharpening


def unsharp_masked(image, amount, radius_px=1.0):
    codes = image.astype(np.float32)
    return np.clip(np.rint(codes + amount * (codes - cv2.GaussianBlur(codes, (0, 0), radius_px))), 0, 255).astype(
        np.uint8
    )


def excess(image, lines, blur_px=0.5, undone=0.0, distance=0.0, learned=True):
    n = len(lines.lines)
    at = np.broadcast_to(distance, n).astype(float)
    sharpened = Sharpened(Optics(SRGB[None], blur_px, ALIGNED), undone)
    return excess_sharpening.for_python(image, lines, np.arange(n), appearance(lines, learned), at, sharpened)


def learned_from(amount, blur_px, radius_px=1.0, noise=0.0, frames=40):
    """The state after frames of edges of all directions, whose blur is learned beside it."""
    rng, state, blur = np.random.default_rng(1), Sharpening(), Blur()
    for _ in range(frames):
        image, lines = edge(blur_px, rng.uniform(0, 360), noise=noise, rng=rng if noise else None)
        seen = state.undone(unsharp_masked(image, amount, radius_px))
        n = len(lines.lines)
        alone = excess_blur.for_python(
            seen, lines, np.arange(n), appearance(lines), np.zeros(n), Optics(SRGB[None], blur.px, ALIGNED)
        )
        shown = excess(seen, lines, blur.px, state.undoes)
        blur.learn(shown.blur_px2 if state.is_suspected else alone, 0.1)
        state.learn(shown.sharpening, 0.1)
    return state


@pytest.mark.parametrize("amount", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("blur", [0.35, 0.5, 0.6])
def test_the_amount_is_learned(blur, amount):
    assert learned_from(amount, blur).amount == pytest.approx(amount, rel=0.25)


def test_noise_does_not_move_it():
    assert learned_from(1.0, 0.6, noise=3.0, frames=80).amount == pytest.approx(1.0, abs=0.2)
    assert learned_from(0.0, 0.6, noise=3.0, frames=80).amount < LEAST_AMOUNT / 2


@pytest.mark.parametrize("blur", [0.32, 0.5, 0.8, 1.2])
def test_images_that_no_camera_sharpened_stay_as_they_are(blur):
    state = learned_from(0.0, blur)
    image, _ = edge(blur, 30)
    assert state.undoes == 0.0
    assert state.undone(image) is image


def beside(image, codes):
    """Root mean square of what the codes of an image are beside others, about its edge."""
    return float(np.sqrt(np.mean(np.square(image.astype(float) - codes))))


@pytest.mark.parametrize("radius_px", [0.8, 1.0, 1.5])
def test_an_image_is_what_it_was_before_it_was_sharpened(radius_px):
    image, _ = edge(0.5, 20)
    seen = unsharp_masked(image, 1.0, radius_px)
    undone = learned_from(1.0, 0.5, radius_px).undone(seen)
    assert beside(undone, image) < beside(seen, image) / 2


def test_it_is_not_told_beside_much_blur():
    """What is enlarged by cubic interpolation has overshoots, too, and undoing them leaves it worse."""
    assert learned_from(1.0, 1.2).undoes == 0.0
    image, lines = edge(0.4, 20)
    large = cv2.resize(image, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    at = lines.lines.copy()
    at[:, :2] = 3 * at[:, :2] + 1
    assert excess(large, lines._replace(lines=at), 1.0, undone=1.0).sharpening == pytest.approx(-0.5)


def test_a_grey_image_is_undone_as_each_channel_of_a_coloured_one():
    image, _ = edge(0.5, 20)
    state = learned_from(0.8, 0.5)
    seen = unsharp_masked(image, 0.8)
    assert (state.undone(np.ascontiguousarray(seen[..., 1])) == state.undone(seen)[..., 1]).all()


def test_blown_out_pixels_remain_so():
    state = learned_from(1.0, 0.5)
    image = np.full((20, 20, 3), 60, np.uint8)
    image[:, 10:] = 255
    image[:, 9] = BLOWN_OUT
    undone = state.undone(image)
    assert (undone[:, 10:] == 255).all()
    assert (undone[:, 9] >= BLOWN_OUT).all()


def test_nothing_is_said_where_no_edge_is_alone_or_known():
    image, lines = edge(0.6, 30)
    assert np.isnan(excess(image, lines, distance=np.inf)).all()
    assert np.isnan(excess(image, lines, learned=False)).all()
    assert np.isnan(excess(np.full_like(image, 90), lines)).all()
    few = np.where(np.arange(len(lines.lines)) < LEAST_MEASURED - 1, 0.0, np.inf)
    assert np.isnan(excess(image, lines, distance=few)).all()


def test_it_stays_in_bounds_and_forgets():
    state = Sharpening()
    state.learn(np.nan, 0.1)
    assert (state.amount, state.asked) == (0.0, 0)
    for _ in range(100):
        state.learn(9.0, 0.1)
    assert state.amount == MOST_AMOUNT
    for _ in range(100):
        state.learn(-9.0, 0.1)
    assert state.amount < LEAST_AMOUNT
    assert state.undoes == 0.0


def test_what_is_not_undone_does_not_add_up():
    state = Sharpening()
    for _ in range(200):
        state.learn(LEAST_AMOUNT / 2, 0.1)
    assert state.amount == pytest.approx(LEAST_AMOUNT / 2)


def test_it_is_asked_of_the_first_frames_then_of_some():
    state = Sharpening()
    assert all(state.asks(frame) for frame in range(ASK_EVERY))
    for _ in range(ASK_EVERY):
        state.learn(0.5, 0.1)
    assert [frame for frame in range(1, 4 * ASK_EVERY) if state.asks(frame)] == [
        ASK_EVERY,
        2 * ASK_EVERY,
        3 * ASK_EVERY,
    ]
