"""The tree of triangles: what rays meet in it, however the triangles lie, and that a traversal has room for it."""

import numpy as np
import pytest

from uavbench.trajectories.geometry.bvh import MAX_DEPTH, build_tree
from uavbench.trajectories.geometry.rays import ray_distances

CORNER = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def apart(scale):
    """Triangles at 1, 1/2, 1/4 ... of a metre before each other: a split by surface takes off one at a time."""
    return np.array([CORNER * s + [0.0, 0.0, s] for s in scale])


def depth_of(tree, node=0):
    if tree.counts[node]:
        return 1
    return 1 + max(depth_of(tree, tree.child[node]), depth_of(tree, tree.child[node] + 1))


@pytest.mark.parametrize(
    "corners",
    [
        apart(0.5 ** np.arange(400)),
        apart(2.0 ** np.arange(400)),
        np.repeat(CORNER[None], 300, axis=0),
        np.zeros((50, 3, 3)),
        np.random.default_rng(1).normal(size=(2000, 3, 3)),
    ],
    ids=["smaller and smaller", "larger and larger", "all the same", "points", "random"],
)
def test_a_traversal_has_room_for_any_tree(corners):
    tree = build_tree(corners)
    assert depth_of(tree) < MAX_DEPTH
    assert sorted(tree.rows) == list(range(len(corners)))
    np.testing.assert_array_equal(tree.corners, corners[tree.rows])


def test_numbers_that_are_none_end_as_triangles_that_nothing_meets():
    corners = np.concatenate([apart([2.0]), np.full((30, 3, 3), np.nan)])
    tree = build_tree(corners)
    assert sorted(tree.rows) == list(range(31))


def test_rays_through_a_tree_meet_what_they_meet_in_all_triangles():
    rng = np.random.default_rng(2)
    corners = rng.uniform(-1, 1, (3000, 1, 3)) * [10, 1, 0.1] + rng.normal(0, 0.1, (3000, 3, 3))
    origins = rng.normal(0, 5, (200, 3))
    ways = corners[:200].mean(axis=1) - origins
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    each = np.min([ray_distances(build_tree(one[None]), origins, ways) for one in corners], axis=0)
    np.testing.assert_array_equal(ray_distances(build_tree(corners), origins, ways), each)
    assert np.isfinite(each).all()


def test_rays_along_a_sheet_enter_few_of_its_boxes():
    """A sheet of a thousand triangles: each ray enters the boxes above it, and few others."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(32.0), np.arange(32.0)))
    tree = build_tree(CORNER + np.stack([x, y, 0 * x], axis=1)[:, None])
    place = np.array([7.3, 21.4])
    inside = ((tree.low[:, :2] <= place) & (place <= tree.high[:, :2])).all(axis=1)
    assert 8 <= inside.sum() <= 24
