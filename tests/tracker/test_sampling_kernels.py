"""Control points: as many as asked for, on all edges in view; and the edges that crowd about each of them."""

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA, box, look_at
from uavbench.scenes.structures.bridge import Bridge
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.measurements import SearchLines
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges
from uavbench.tracker.robust.edges.steps.optics_kernels import FIRST_BLUR_PX
from uavbench.tracker.robust.edges.steps.step_kernels import CLEAR_WIDTHS
from uavbench.tracker.robust.edges.steps.sum_kernels import REACH_PX
from uavbench.tracker.robust.edges.subpixel_kernels import Crowd, crowd, edges_near, extents_of_edges
from uavbench.tracker.robust.view import View

SPACING_PX = RobustConfig().edges.sampling.spacing_px


def sampled(structure, pose, most):
    edges = EdgeMap.of(structure, RobustConfig().edges.sampling.rounded_deg)
    view = View.of(CAMERA, structure).at(pose)
    points = sample_edges(edges, view, SPACING_PX, most)
    length_px = []
    for edge in points.keys[points.first[:-1], 0]:
        length_px.append(np.linalg.norm(np.diff(CAMERA.project(pose.transform(edges.ends[edge])), axis=0)))
    return points, np.diff(points.first), np.array(length_px)


def test_where_all_fit_every_edge_has_a_point_in_each_spacing():
    _, counts, length_px = sampled(box(), look_at(np.array([1.6, 1.2, 0.9]), (0, 0, 0.2)), 400)
    np.testing.assert_allclose(counts, length_px / SPACING_PX, atol=0.51)


def test_where_points_are_scarce_their_number_grows_with_the_root_of_the_length():
    _, counts, length_px = sampled(box((3.0, 0.3, 0.1)), look_at(np.array([1.0, 4.0, 2.0]), (0, 0, 0.05)), 40)
    long = length_px.max()
    assert long > 6 * length_px.min(), "the edges must differ"
    expected = counts.max() * np.sqrt(length_px / long)
    np.testing.assert_allclose(counts, expected, atol=1.01)


@pytest.mark.parametrize("most", [60, 200, 400])
@pytest.mark.parametrize("eye", [(-8.0, -8.0, 2.0), (0.0, -20.0, 6.0), (5.0, -5.0, 1.0)])
def test_about_as_many_are_visible_as_asked_for_however_many_are_hidden(bridge, eye, most):
    points, _, _ = sampled(bridge, look_at(np.array(eye), (0, 0, 4.0)), most)
    assert 0.5 * most < len(points.points) < 1.8 * most, "short edges of one length get a point all at once"


@pytest.fixture(scope="module")
def bridge():
    return Bridge().unpainted().structure


def lines_of(*edges):
    """Search lines and first rows of edges, each a list of pixels and a normal."""
    rows = [[u, v, *normal] for pixels, normal in edges for u, v in pixels]
    first = np.cumsum([0] + [len(pixels) for pixels, _ in edges])
    lines = np.array(rows, dtype=float)
    return SearchLines(lines, np.zeros((len(lines), 6)), np.zeros(len(lines), np.int64)), first


def crowd_of(at, first, p, most=6):
    crowded = Crowd(np.full((most, 4), np.nan), np.zeros(most, np.int64))
    group, reach_px = int(np.searchsorted(first, p, side="right")) - 1, REACH_PX + CLEAR_WIDTHS * FIRST_BLUR_PX
    extents, others = extents_of_edges.for_python(at, first), np.zeros(len(first) - 1, np.int64)
    near = others[: edges_near(extents, group, reach_px, others)]
    count = crowd(at, first, p, extents.half_px, near, reach_px, crowded)
    np.testing.assert_array_equal(at.lines[crowded.points[:count], :2], crowded.lines[:count, :2])
    return crowded.lines[:count]


def test_edges_that_are_far_from_all_of_an_edge_are_not_looked_at():
    us = (100.0, 106.0, 112.0)
    lines = horizontal(50.0, us), horizontal(52.0, us), horizontal(90.0, us), horizontal(50.0, (140.0, 146.0))
    at, first = lines_of(*lines)
    extents, others = extents_of_edges.for_python(at, first), np.zeros(len(first) - 1, np.int64)
    np.testing.assert_array_equal(extents.half_px, 3.0)
    np.testing.assert_array_equal(extents.box[0], [100, 50, 112, 50])
    assert others[: edges_near(extents, 0, 4.5, others)].tolist() == [1]
    assert others[: edges_near(extents, 0, 40.0, others)].tolist() == [1, 2, 3]


def horizontal(v, us, up=1.0):
    return [(u, v) for u in us], (0.0, up)


def test_a_crowd_is_of_parallel_edges_within_reach_seen_from_one_side():
    us = (100.0, 106.0, 112.0)
    at, first = lines_of(
        horizontal(50.0, us),
        horizontal(52.0, us, up=-1.0),  # the other way round
        horizontal(50.1, us),  # the same step of the image
        horizontal(60.0, us),  # too far
        horizontal(51.0, (300.0, 306.0)),  # elsewhere
        ([(106.0, 46.0), (106.0, 52.0)], (1.0, 0.0)),  # across
    )
    np.testing.assert_allclose(crowd_of(at, first, 1), [[106, 50, 0, 1], [106, 52, 0, 1]])


def test_an_edge_ends_half_a_spacing_beyond_its_last_point():
    near, beyond = ([horizontal(50.0, (100.0,)), horizontal(51.5, us)] for us in ((104.0, 112.0), (110.0, 118.0)))
    assert len(crowd_of(*lines_of(*near), 0)) == 2
    assert len(crowd_of(*lines_of(*beyond), 0)) == 1


def test_too_many_edges_are_none():
    at, first = lines_of(*(horizontal(50.0 + 0.6 * k, (100.0, 106.0)) for k in range(7)))
    assert len(crowd_of(at, first, 0)) == 0
