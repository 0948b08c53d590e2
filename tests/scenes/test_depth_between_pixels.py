"""Depth between pixels: that of a plane to the rounding of the file, and of no surface but those on either side."""

import numpy as np
import pytest

from uavbench.scenes.dataset.surfaces.depth_between_pixels import sampled_depth

F, H, W = 150.0, 90, 120
V, U = np.mgrid[0:H, 0:W].astype(float)
FLOOR = (0.0, -0.9, 1.2)
"""A plane as in w = (a x + b y + 1) / c of the normalized image coordinates: slanted, 1.2 m away in the middle."""


def plane(u, v, slope_x, slope_y, depth_m):
    """Depth (...) in m of a plane at pixels (...)."""
    return depth_m / (1 + slope_x * (u - W / 2) / F + slope_y * (v - H / 2) / F)


def rounded(depth_m):
    return np.round(depth_m, 3)


def places(u, v):
    return np.dstack([u, v]).astype(np.float32)


@pytest.mark.parametrize("slopes", [(0.0, -0.9), (1.3, 0.4), (-0.7, 1.5), (0.0, 0.0)])
@pytest.mark.parametrize("depth_m", [0.6, 8.0])
def test_a_slanted_plane_is_where_it_is_between_pixels_too(slopes, depth_m):
    u, v = U[3:-3, 3:-3] + 0.46, V[3:-3, 3:-3] - 0.38
    found = sampled_depth(rounded(plane(U, V, *slopes, depth_m)), places(u, v), 0.001)
    assert np.abs(found - plane(u, v, *slopes, depth_m)).max() < 0.001


@pytest.mark.parametrize("across", [U + 0 * V, V + 0 * U, U + V, U - 2 * V + 60])
def test_between_two_surfaces_there_is_none_of_neither(across):
    """A step from 0.8 m to 2.5 m: every depth is one of them, whatever its direction in the image."""
    near = across < np.median(across)
    depth = rounded(np.where(near, plane(U, V, 0.3, 0.2, 0.8), plane(U, V, 0.0, -0.4, 2.5)))
    u, v = U[2:-2, 2:-2] + 0.5, V[2:-2, 2:-2] + 0.3
    found = sampled_depth(depth, places(u, v), 0.001)
    either = [np.abs(found - plane(u, v, *of)) for of in ((0.3, 0.2, 0.8), (0.0, -0.4, 2.5))]
    assert np.minimum(*either).max() < 0.03  # at the step, the depth of the nearest pixel


def test_where_there_is_no_surface_there_is_no_depth():
    depth = rounded(plane(U, V, *FLOOR))
    depth[:40] = 0
    outside = places(np.full((3, 3), -1e4), np.full((3, 3), -1e4))
    assert not sampled_depth(depth, outside, 0.001).any()
    found = sampled_depth(depth, places(U + 0.2, V + 0.2), 0.001)
    assert not found[:39, :-1].any() and (found[40:-1, :-1] > 0).all()
    assert not sampled_depth(np.zeros((H, W)), places(U, V), 0.001).any()


def test_a_centre_of_a_pixel_has_its_own_depth():
    depth = rounded(plane(U, V, *FLOOR))
    np.testing.assert_allclose(sampled_depth(depth, places(U, V), 0.001), depth, rtol=1e-12)
