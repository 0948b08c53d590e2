"""Grey values of all texels of a patch at once are those of one texel after another, to the bit."""

import numpy as np
import pytest

from uavbench.tracker.robust.patches.likeness_kernels import Between, Texels, sample, sample_texels
from uavbench.tracker.robust.patches.matches import HALF, SIDE, Warp

WIDTH, HEIGHT = 40, 30


def room():
    """Room for the texels of a patch, full of what no image has."""
    n = SIDE * SIDE
    between = Between(np.full(n, -1, np.int32), np.full(n, 7.0), np.full(n, 7.0), np.full((4, n), 99, np.uint8))
    return Texels(np.full((SIDE, SIDE), -1.0), between)


@pytest.mark.parametrize("channels", [1, 3])
def test_texels_anywhere_are_as_one_by_one(channels):
    rng = np.random.default_rng(channels)
    image = rng.integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)
    into, outside = room(), 0
    for _ in range(300):
        middle, steps = rng.uniform((-2.0, -2.0), (WIDTH + 2.0, HEIGHT + 2.0)), rng.normal(0.0, 1.0, 4)
        at, (da, db) = Warp(*middle, *steps, alike=True), rng.normal(0.0, 1.0, 2)
        expected = np.empty((SIDE, SIDE))
        sample(image, at, da, db, expected)
        sample_texels(image, at, da, db, into)
        np.testing.assert_array_equal(into.grey, expected)
        outside += int(np.isnan(expected).any())
    assert 50 < outside < 250


@pytest.mark.parametrize(("u", "v"), [(HALF, HALF), (WIDTH - 2 - HALF, HEIGHT - 2 - HALF), (HALF, HEIGHT - 1.1 - HALF)])
def test_texels_at_the_border_of_an_image_are_as_one_by_one(u, v):
    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 1), np.uint8)
    into, expected = room(), np.empty((SIDE, SIDE))
    for at in (Warp(u, v, 1.0, 0.0, 0.0, 1.0, alike=True), Warp(u + 1e-9, v, -1.0, 0.0, 0.0, -1.0, alike=True)):
        sample(image, at, 0.0, 0.0, expected)
        sample_texels(image, at, 0.0, 0.0, into)
        np.testing.assert_array_equal(into.grey, expected)
    assert not np.isnan(expected).any()


def test_no_texels_are_where_a_patch_has_no_place():
    image, into = np.zeros((HEIGHT, WIDTH, 1), np.uint8), room()
    sample_texels(image, Warp(np.nan, 15.0, 1.0, 0.0, 0.0, 1.0, alike=True), 0.0, 0.0, into)
    assert np.isnan(into.grey).all()
