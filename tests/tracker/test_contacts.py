"""Parts of a model that touch: an edge where faces of two parts lie in one plane is not one of the structure."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, box, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.beside.contact_kernels import PARTS
from uavbench.tracker.robust.edges.columns import BOTH_FACES, FACES
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.view import View

NEAR_M = 1e-6


def boxes(*low_high):
    """One structure of boxes, each from its lowest to its highest corner."""
    corners = []
    for low, high in low_high:
        low, high = np.array(low, dtype=float), np.array(high, dtype=float)
        middle = 0.5 * (low + high)[:2]
        corners.append(box_corners(tuple(high - low), tuple(middle)) + np.array([0.0, 0.0, low[2]]))
    triangles = [BOX_TRIANGLES + 8 * k for k in range(len(corners))]
    return Structure.from_mesh(np.concatenate(corners), np.concatenate(triangles))


def sampled(structure, eye, target=(0.0, 0.0, 0.3)):
    edges = EdgeMap.of(structure, RobustConfig().edges.sampling.rounded_deg)
    return sample_edges(edges, View.of(CAMERA, structure).at(look_at(np.array(eye), target)), 4.0, 400)


def on_edges(points, structure):
    """Mask of the points that lie on an edge of a structure."""
    start, along = structure.edge_segments[:, 0], np.diff(structure.edge_segments, axis=1)[:, 0]
    part = np.einsum("nek,ek->ne", points[:, None] - start, along) / np.einsum("ek,ek->e", along, along)
    nearest = start + np.clip(part, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1) < NEAR_M


EYES = st.tuples(st.floats(0, 2 * np.pi), st.floats(0.05, 0.6)).map(
    lambda at: (3 * np.cos(at[0]) * np.cos(at[1]), 3 * np.sin(at[0]) * np.cos(at[1]), 0.3 + 3 * np.sin(at[1]))
)


@settings(max_examples=40, deadline=None)
@given(cut=st.floats(0.2, 0.8), axis=st.integers(0, 2), eye=EYES)
def test_a_box_that_is_cut_in_two_has_the_edges_of_a_box(cut, axis, eye):
    low, high = np.array([-0.5, -0.4, 0.0]), np.array([0.5, 0.4, 0.7])
    one_high, two_low = high.copy(), low.copy()
    one_high[axis] = two_low[axis] = low[axis] + cut * (high - low)[axis]
    whole = boxes((low, high))
    of_parts = sampled(boxes((low, one_high), (two_low, high)), eye).points
    assert on_edges(of_parts, whole).all()
    assert len(of_parts) == pytest.approx(len(sampled(whole, eye).points), abs=9)  # rounded on each of nine edges


def test_the_sides_of_steps_show_the_steps_alone():
    steps = [((0.3 * k, -0.3, 0.0), (0.3 * (k + 1), 0.3, 0.8 - 0.2 * k)) for k in range(4)]
    points = sampled(boxes(*steps), (1.0, -3.0, 0.6), (0.6, 0.0, 0.4)).points
    side = points[np.abs(points[:, 1] + 0.3) < NEAR_M]
    upright = (np.abs(side[:, 0][:, None] - [0.3, 0.6, 0.9]) < NEAR_M).any(axis=1) & (side[:, 2] > 0.01)
    next_step_m = 0.8 - 0.2 * np.round(side[upright, 0] / 0.3)
    assert upright.any(), "the risers are seen"
    assert (side[upright, 2] > next_step_m - 0.8 / 32).all(), "below the next step its side goes on"


def test_a_part_that_stands_back_keeps_its_edge():
    flush = boxes(((-0.5, -0.3, 0.0), (0.0, 0.3, 0.6)), ((0.0, -0.3, 0.0), (0.5, 0.3, 0.6)))
    back = boxes(((-0.5, -0.3, 0.0), (0.0, 0.3, 0.6)), ((0.0, -0.28, 0.0), (0.5, 0.3, 0.6)))
    at_joint = [np.abs(sampled(each, (0.4, -3.0, 0.4)).points[:, 0]) < NEAR_M for each in (flush, back)]
    assert at_joint[0].sum() == 0
    assert at_joint[1].sum() > 20


def test_an_edge_on_a_wall_keeps_both_of_its_faces():
    wall, sill = ((-1.0, 0.0, 0.0), (1.0, 0.2, 1.0)), ((-0.3, -0.1, 0.4), (0.3, 0.0, 0.5))
    alone, built_in = sampled(boxes(sill), (0.5, -2.5, 1.2)), sampled(boxes(wall, sill), (0.5, -2.5, 1.2))
    front = [each.points[:, 1] < -0.1 + NEAR_M for each in (alone, built_in)]
    assert abs(int(front[0].sum()) - int(front[1].sum())) <= 4
    np.testing.assert_array_equal(np.unique(alone.keys[front[0], FACES]), np.unique(built_in.keys[front[1], FACES]))
    on_wall = built_in.points[np.abs(built_in.points[:, 1]) < NEAR_M]
    assert ((np.abs(on_wall[:, 2] - 0.5) < NEAR_M) & (np.abs(on_wall[:, 0]) < 0.3)).any(), "where it meets the wall"


def test_a_structure_of_one_part_shows_all_of_its_faces():
    shown = EdgeMap.of(box(), RobustConfig().edges.sampling.rounded_deg).shown
    np.testing.assert_array_equal(shown, np.broadcast_to(np.array([[1], [2], [3]]), shown.shape))


def test_sheets_that_are_drawn_from_both_sides_keep_their_edges():
    triangles = np.concatenate([BOX_TRIANGLES, BOX_TRIANGLES[:, ::-1]])
    one_sided, eye = boxes(((-0.5, -0.4, 0.0), (0.5, 0.4, 0.7))), (1.5, -2.5, 1.5)
    corners = box_corners((1.0, 0.8, 0.7), (0.0, 0.0))
    apart = Structure.from_mesh(np.concatenate([corners, corners]), np.concatenate([BOX_TRIANGLES, triangles[12:] + 8]))
    shown = EdgeMap.of(apart, RobustConfig().edges.sampling.rounded_deg).shown
    assert (shown[:, 2] > 0).all()
    assert len(sampled(apart, eye).points) >= len(sampled(one_sided, eye).points)


def test_an_edge_that_lies_on_blocks_and_on_a_sheet_between_them_is_covered_by_the_blocks():
    bar, blocks = ((-1.0, -0.1, 0.5), (1.0, 0.1, 0.6)), [((x, -0.4, 0.0), (x + 0.9, 0.4, 0.5)) for x in (-1.2, 0.3)]
    solid = boxes(bar, *blocks)
    sheet = np.array([[-0.3, -0.4, 0.5], [0.3, -0.4, 0.5], [0.3, 0.4, 0.5], [-0.3, 0.4, 0.5]])
    both_sides = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]) + len(solid.vertices)
    corners, triangles = np.concatenate([solid.vertices, sheet]), np.concatenate([solid.triangles, both_sides])
    edges = EdgeMap.of(Structure.from_mesh(corners, triangles), RobustConfig().edges.sampling.rounded_deg)
    ends, along = edges.ends, np.abs(np.diff(edges.ends, axis=1)[:, 0])
    beneath = (along[:, 0] > 1.9) & (np.abs(ends[..., 2] - 0.5) < NEAR_M).all(axis=1)
    parts = (np.arange(PARTS) + 0.5) / PARTS
    x = ends[beneath, 0, :1] + parts * np.diff(ends[beneath, :, 0], axis=1)
    assert beneath.sum() == 2
    np.testing.assert_array_equal(edges.shown[beneath, BOTH_FACES - 1] == BOTH_FACES, np.abs(x) < 0.3)
