"""The variance of a patch: young patches are as exact as old ones, and are believed nearly so."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, flown
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.patches.patch_kernels import YOUNG_S
from uavbench.tracker.robust.patches.patches import Texture
from uavbench.tracker.robust.view import View

FRAME_S = 1 / 15
CONFIG = RobustConfig()


def taken(image, pose):
    """Patches of an image at time 0."""
    edges = EdgeMap.of(box(), CONFIG.edges.sampling.rounded_deg)
    texture = Texture(edges, CAMERA, View.of(CAMERA, box()), CONFIG)
    texture.take(image, pose, np.zeros((0, 2)))
    return texture


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("age", [1, 2, 4])
def test_young_patches_lie_where_their_variance_says(seed, age):
    """In one direction chi-square is 0.25 to 1.4; with variances that fall over a second it is 0.04 after a frame."""
    poses, images = flown(age + 1, seed=seed)
    texture, view = taken(images[0], poses[0]), View.of(CAMERA, box()).at(poses[age])
    texture.now_s = age * FRAME_S
    texture.choose(view)
    places, observed, correlation, variance = texture.align(images[age], view)
    found = correlation > 0
    assert found.sum() > 6
    moved = (observed - CAMERA.project(poses[age].transform(places)))[found]
    squares = (moved - np.median(moved, axis=0)) ** 2 / variance[found, None]
    assert 0.1 < squares.mean() < 3.0


def test_a_patch_as_old_as_young_ones_are_has_twice_the_variance_of_an_old_one():
    poses, images = flown(1, seed=11)
    texture, view = taken(images[0], poses[0]), View.of(CAMERA, box()).at(poses[0])
    texture.choose(view)
    found = []
    for age_s in (YOUNG_S, 1e6):
        texture.now_s = age_s
        found.append(texture.align(images[0], view).variance_px2)
    np.testing.assert_allclose(found[0], 2.0 * found[1], rtol=1e-6)
