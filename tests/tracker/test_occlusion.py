"""What a triangle hides: against a dense test of rays, and at each of its borders."""

import numpy as np
import pytest

from uavbench.tracker.geometry_kernels import Point
from uavbench.tracker.robust.edges.hidden_line_kernels import MARGIN, NONE, Triangles, hidden, occluder, sight_from
from uavbench.trajectories.geometry.bvh import build_tree
from uavbench.trajectories.geometry.bvh_kernels import LEAF

EYE = np.zeros(3)
WALL = np.array([[[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [-1.0, 1.0, 2.0]]])
"""One triangle 2 m before the eye; what lies beyond its long side is not hidden."""


def hides(corners, point, eye=EYE, face=None, beside=(-1, -2)):
    tree = build_tree(corners)
    face = np.arange(len(corners)) if face is None else np.asarray(face)
    eye, point = np.asarray(eye, float), np.asarray(point, float)
    return bool(hidden(sight_from(eye), point, Triangles.of(tree, face), *beside))


def crosses(corners, eye, point):
    """Which triangles the way from the eye to a point crosses (m,), by barycentric coordinates solved densely."""
    found = []
    for a, b, c in corners:
        try:
            u, v, s = np.linalg.solve(np.column_stack([b - a, c - a, eye - point]), eye - a)
        except np.linalg.LinAlgError:
            found.append(False)
            continue
        found.append(u >= 0 and v >= 0 and u + v <= 1 and 1e-9 < s < 1 - MARGIN)
    return np.array(found)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (-0.5, -0.5, True),
        (-0.99, 0.97, True),
        (0.97, -0.99, True),
        (0.01, -0.02, True),
        (0.02, -0.01, False),  # beyond the long side
        (0.9, 0.9, False),
        (-1.01, 0.0, False),
        (0.0, -1.01, False),
        (-1.01, -1.01, False),
        (1.01, -1.0, False),
    ],
)
def test_a_triangle_hides_what_lies_behind_it_and_no_more(x, y, expected):
    assert hides(WALL, 2.0 * np.array([x, y, 2.0])) == expected
    assert hides(WALL[:, [2, 0, 1]], 2.0 * np.array([x, y, 2.0])) == expected
    assert hides(WALL[:, ::-1], 2.0 * np.array([x, y, 2.0])) == expected


@pytest.mark.parametrize("winding", [(0, 1, 2), (0, 2, 1)])
@pytest.mark.parametrize(
    ("x", "y"), [(0.25, 0.25), (0.0, 0.5), (0.5, 0.0), (0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
)
def test_the_border_of_a_triangle_belongs_to_it(x, y, winding):
    """So that nothing is seen between two triangles; all numbers here are exact."""
    corner = np.array([[[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]])[:, winding]
    crossing, aslant = np.array([x, y, 0.5]), np.array([0.25, 0.125, 0.5])
    assert hides(corner, crossing + aslant, crossing - aslant)
    assert not hides(corner, crossing + aslant + [1.5, 0.0, 0.0], crossing - aslant + [1.5, 0.0, 0.0])


@pytest.mark.parametrize(
    ("depth", "expected"),
    [(4.0, True), (2.0, False), (1.9, False), (-4.0, False), (2.0 * (1 + 2.5e-4), False), (2.0 * (1 + 7.5e-4), True)],
)
def test_only_what_lies_nearer_hides(depth, expected):
    assert hides(WALL, depth * np.array([-0.1, -0.1, 1.0])) == expected


def test_a_triangle_through_the_eye_hides_nothing():
    through = np.array([[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, -1.0]]])
    assert not hides(through, [0.0, 0.1, 3.0])


def test_neither_face_of_an_edge_hides_it():
    """A wedge: its ridge lies on both faces, and rounding puts it now before and now behind them."""
    point = np.array([-0.4, -0.3, 4.0])
    for faces, beside in (((7,), (7, 3)), ((7,), (3, 7)), ((7,), (7, 7))):
        assert not hides(WALL, point, face=faces, beside=beside)
    assert hides(WALL, point, face=(7,), beside=(3, 4))
    both = np.concatenate([WALL, WALL + np.array([0.0, 0.0, 0.5])])
    assert not hides(both, point, face=(7, 3), beside=(7, 3))
    assert hides(both, point, face=(7, 4), beside=(7, 3))
    assert hides(both, point, face=(4, 7), beside=(3, 7))


@pytest.mark.parametrize("count", [1, LEAF, LEAF + 1, 60])
def test_the_tree_finds_what_a_test_of_every_triangle_finds(count):
    rng = np.random.default_rng(count)
    corners = rng.uniform(-2, 2, (count, 1, 3)) + rng.normal(0, 1.0, (count, 3, 3))
    face = rng.integers(0, count + 5, count)
    answers = []
    for _ in range(60):
        eye, aim = rng.uniform(-3, 3, 3), corners[rng.integers(count)].mean(axis=0) + rng.normal(0, 0.3, 3)
        point = eye + rng.uniform(0.8, 2.5) * (aim - eye)
        beside = tuple(rng.integers(0, count + 5, 2))
        answers.append((crosses(corners, eye, point) & ~np.isin(face, beside)).any())
        assert hides(corners, point, eye, face, beside) == answers[-1]
    assert 0 < sum(answers) < 60


def test_the_triangle_that_is_tried_first_changes_no_answer():
    rng = np.random.default_rng(5)
    corners, face = rng.uniform(-2, 2, (12, 3, 3)), rng.integers(0, 4, 12)
    tree = Triangles.of(build_tree(corners), face)
    answers = []
    for _ in range(300):
        eye, point, beside = rng.uniform(-3, 3, 3), rng.uniform(-3, 3, 3), rng.integers(0, 4, 2)
        answers.append(hidden(sight_from(eye), point, tree, *beside))
        at = Point(*point)
        assert [occluder(sight_from(eye), at, tree, *beside, k) != NONE for k in range(12)] == [answers[-1]] * 12
    assert 0 < sum(answers) < 300


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("aside", "expected"), [(-0.4, True), (0.4, False), (-1.4, False)])
def test_a_way_along_an_axis_is_as_any_other(axis, sign, aside, expected):
    """Two parts of its direction are zero: it never crosses the planes of the boxes across them."""
    wall = np.roll(WALL * [1, 1, sign], axis - 2, axis=2)
    eye, ahead = np.roll([aside, aside, 0.0], axis - 2), np.roll([0.0, 0.0, 5.0 * sign], axis - 2)
    assert hides(wall, eye + ahead, eye) == expected


def test_every_triangle_is_in_one_leaf_and_every_box_holds_its_own():
    corners = np.random.default_rng(0).normal(size=(37, 3, 3))
    tree = build_tree(corners)
    triangles, order = Triangles.of(tree, np.arange(37)), tree.rows
    boxes, nodes = triangles.boxes, triangles.nodes
    assert sorted(order.tolist()) == list(range(37))
    seen = []

    def walk(node):
        left, right = nodes[node].tolist()
        if left < 0:
            mine = order[-left - 1 : -left - 1 + right].tolist()
            assert 1 <= len(mine) <= LEAF
            seen.extend(mine)
        else:
            mine = walk(left) + walk(right)
        np.testing.assert_array_equal(boxes[node, 0], corners[mine].min(axis=(0, 1)))
        np.testing.assert_array_equal(boxes[node, 1], corners[mine].max(axis=(0, 1)))
        return mine

    assert sorted(walk(0)) == list(range(37))
    assert sorted(seen) == list(range(37))
    assert len(nodes) <= 2 * 37 - 1
