"""Structures of many edges: what is out of view takes neither budget nor memory, and nothing that is seen is missed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, box_corners, flown, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.protocol import check_image
from uavbench.tracker.registry import TRACKERS
from uavbench.tracker.robust.config import RobustConfig
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.groups import GROUP, Groups, interleaved
from uavbench.tracker.robust.edges.visible_kernels import visible_parts
from uavbench.tracker.robust.fit.edge_fit import EdgeFitter
from uavbench.tracker.robust.mostly_zero import LARGE, mostly_zero
from uavbench.tracker.robust.preprocessing.gain_offset import GainOffset, compensated
from uavbench.tracker.robust.row_numbers import row_numbers
from uavbench.tracker.robust.view import View
from uavbench.tracker.robust.work import PER_EDGE
from uavbench.tracker.stage_clock import StageClock

ROUNDED_DEG = RobustConfig().edges.sampling.rounded_deg


def structure_of(corners):
    triangles = BOX_TRIANGLES + 8 * np.arange(len(corners))[:, None, None]
    return Structure.from_mesh(np.concatenate(corners), triangles.reshape(-1, 3))


def row_of_boxes(count, apart_m=1.0, y_m=0.0):
    """Boxes along x, the middle one at x = 0."""
    return [box_corners(centre=((k - count // 2) * apart_m, y_m)) for k in range(count)]


def scattered(count, seed):
    """Boxes of all sizes anywhere about the origin."""
    rng = np.random.default_rng(seed)
    sizes, places = rng.uniform(0.05, 1.0, (count, 3)), rng.uniform(-6.0, 6.0, (count, 3))
    return structure_of([box_corners(size) + place for size, place in zip(sizes, places, strict=True)])


SCATTERED = EdgeMap.of(scattered(120, 4), ROUNDED_DEG)
ENDLESS = SCATTERED.groups.spheres.copy()
ENDLESS[:, 3] = np.inf
OF_ALL = SCATTERED._replace(groups=Groups(SCATTERED.groups.order, ENDLESS))
VIEW = View.of(CAMERA, scattered(120, 4))


@settings(max_examples=60)
@given(st.tuples(*[st.floats(-8, 8)] * 3), st.tuples(*[st.floats(-8, 8)] * 3), st.floats(-3, 3))
def test_no_visible_edge_is_passed_over_with_its_group(eye, target, roll):
    eye, target = np.array(eye), np.array(target)
    if np.linalg.norm((target - eye)[:2]) < 1e-3:
        target[0] += 1.0
    view = VIEW.at(look_at(eye, target, roll))
    grouped, all_of = visible_parts(SCATTERED, view), visible_parts(OF_ALL, view)
    for one, other in zip(grouped, all_of, strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_edge_is_in_one_group_within_its_sphere():
    order, spheres = SCATTERED.groups
    assert sorted(order) == list(range(len(SCATTERED.ends)))
    for place, edge in enumerate(order):
        centre, radius = spheres[place // GROUP, :3], spheres[place // GROUP, 3]
        assert np.linalg.norm(SCATTERED.ends[edge] - centre, axis=1).max() <= radius * (1 + 1e-12)


def test_places_beside_each_other_have_numbers_beside_each_other():
    """Along the curve eight cells of a cube come before the next cube's."""
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    assert sorted(interleaved(cube)) == list(range(8))
    assert sorted(interleaved(cube + 2)) == list(range(56, 64))


def test_a_structure_without_edges_has_no_groups():
    order, spheres = Groups.of(np.zeros((0, 2, 3)))
    assert (len(order), len(spheres)) == (0, 0)


def test_a_fit_looks_at_the_edges_near_its_view_alone():
    """Of 401 boxes in a row, 1 m apart, some four are in a view of 65 degrees from 3 m away."""
    edges = EdgeMap.of(structure_of(row_of_boxes(401)), ROUNDED_DEG)
    view = View.of(CAMERA, structure_of(row_of_boxes(401)))
    visible_parts(edges, view.at(look_at(np.array([0.5, -3.0, 1.0]), (0.5, 0, 0))))
    assert 4 * 12 <= edges.looked_at <= 12 * 12


def test_what_is_out_of_view_changes_neither_poses_nor_the_work_of_a_frame():
    """Far away are 400 boxes more, of 360,000 evaluations, half of what a fit takes, were they counted."""
    flight = flown(6, seed=5)
    alone, behind = box_corners(), row_of_boxes(400, 0.6, y_m=300.0)
    found = []
    for structure in (structure_of([alone]), structure_of([alone, *behind])):
        fitter = EdgeFitter(structure, CAMERA, np.random.default_rng(0), RobustConfig())
        fitter.begin(0, 0.1)
        fit = fitter.fit(check_image(flight.images[0], CAMERA), flight.poses[0], 1e-6 * np.eye(6), StageClock())
        run = TRACKERS["robust"]().start(structure, CAMERA, flight.poses[0], np.random.default_rng(0))
        results = [run.track(image, k * 66_666_667) for k, image in enumerate(flight.images)]
        found.append((fit.cam_from_world.translation, fitter.work.done, fitter.cost(1), results))
    (at, done, cost, results), (at_large, done_large, cost_large, of_large) = found
    np.testing.assert_allclose(at_large, at, atol=1e-9)
    of_groups = 3 * GROUP * PER_EDGE  # of which one edge is near the view
    assert 0 <= done_large - done <= of_groups
    assert 0 <= cost_large - cost <= of_groups
    assert [each.status for each in of_large] == [each.status for each in results] == ["ok"] * 6


@settings(max_examples=80)
@given(st.lists(st.tuples(*[st.integers(-3, 3)] * 3), max_size=30))
def test_rows_are_numbered_in_lexicographic_order(rows):
    rows = np.array(rows, dtype=np.int64).reshape(-1, 3)
    _, expected = np.unique(rows, axis=0, return_inverse=True)
    _, found = np.unique(row_numbers(rows), return_inverse=True)
    np.testing.assert_array_equal(found, expected.ravel())


def test_rows_of_numbers_that_are_far_apart_are_told_still():
    rows = np.array([[k * 2**40, -k * 2**50, k % 2 * 2**60] for k in range(40)])
    found = row_numbers(rows).tolist()
    assert found == sorted(set(found)), "whole numbers, which do not wrap around as differences of an array do"


@pytest.mark.parametrize("rows", [3, LARGE // 64 + 1])
def test_arrays_that_are_mostly_zero_are_arrays(rows):
    found = mostly_zero(rows, 8)
    assert (found.shape, found.dtype, found.flags.c_contiguous, found.any()) == ((rows, 8), np.float64, True, False)
    found[-1, -1] = 2.0
    assert found.sum() == 2.0


def test_of_colours_that_change_those_that_were_seen_are_kept():
    appearance = np.arange(80.0).reshape(10, 8)
    found = compensated(appearance, np.array([2, 5]), GainOffset(np.array([2.0]), np.array([1.0])))
    for row in (2, 5):
        expected = appearance[row].copy()
        expected[[0, 3]] = 2.0 * expected[[0, 3]] + 1.0
        np.testing.assert_array_equal(found[row], expected)
    assert not np.delete(found, [2, 5], axis=0).any()
