"""How far each control point is trusted, and how much it errs."""

import numpy as np
import pytest

from uavbench.tracker.robust.config.edges import AppearanceConfig, WeightConfig
from uavbench.tracker.robust.edges.columns import OUTSIDE
from uavbench.tracker.robust.edges.measurements import Candidates, ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import learn_squares
from uavbench.tracker.robust.edges.weight_kernels import (
    contrast_weights,
    edge_spacing,
    known_rows,
    offset_variances,
    point_variances,
    support,
)
from uavbench.tracker.robust.kernel_values import kernel_values

WEIGHTS = WeightConfig()
WEAK_STEP = AppearanceConfig().weak_step_grey
OWN_VARIANCE = WEIGHTS.point_variance_px2
LOOKS = 10.0
OFFSET_VARIANCE, SHARED = WEIGHTS.offset_variance_px2, WEIGHTS.shared_part


def of_one_edge(learned, *, times=1.0, side=1, distance=0.2, contrast=50.0, trusted=1.0):
    """Variances of three control points of one edge, whose appearance was learned so many times."""
    n = 3
    appearance = np.zeros((n, 8))
    appearance[:, 6], appearance[:, 7] = times, learned
    points = ControlPoints(np.zeros((n, 3)), np.zeros((n, 3), np.int64), np.arange(n), np.array([0, n]))
    found = Candidates(np.full((n, 1), distance), np.full((n, 1), contrast))
    own = point_variances(points, found, appearance, WEAK_STEP, kernel_values(WEIGHTS))
    lines = SearchLines(np.zeros((n, 4)), np.zeros((n, 6)), np.full(n, side))
    measured = EdgeMeasurements(points, lines, found, np.full(n, trusted), own, np.zeros((n, 0)))
    return own, offset_variances(measured, appearance, LOOKS, kernel_values(WEIGHTS))


@pytest.mark.parametrize("learned", [1e-4, 0.01, 0.4])
def test_a_control_point_errs_by_what_was_learned_of_it(learned):
    own, shared = of_one_edge(learned)
    assert own == pytest.approx([OWN_VARIANCE + learned] * 3)
    assert shared == pytest.approx([min(OFFSET_VARIANCE, SHARED * learned)])


def test_one_that_is_not_known_yet_errs_by_its_contrast():
    for contrast in (WEAK_STEP / 2, WEAK_STEP, 4 * WEAK_STEP):
        own, shared = of_one_edge(9.0, times=0.0, contrast=contrast)
        assert own == pytest.approx([OWN_VARIANCE + min(1.0, WEAK_STEP / contrast) ** 2] * 3)
        assert shared == pytest.approx([OFFSET_VARIANCE])


def test_the_offset_of_an_edge_is_wider_where_it_weighs_less_and_never_wider_than_its_points():
    assert of_one_edge(9.0, side=0)[1] == pytest.approx([OFFSET_VARIANCE])
    assert of_one_edge(9.0, trusted=0.5)[1] == pytest.approx([2 * OFFSET_VARIANCE])
    assert of_one_edge(9.0, trusted=0.001)[1] == pytest.approx([50 * OFFSET_VARIANCE])
    assert of_one_edge(9.0, distance=np.inf)[1] == pytest.approx([OFFSET_VARIANCE])
    assert of_one_edge(1e-3, trusted=0.001)[1] == pytest.approx([SHARED * 1e-3])


def test_the_offset_of_an_edge_that_was_often_seen_is_as_wide_as_it_was_found_to_be():
    for times, variance in ((1.0, OFFSET_VARIANCE), (LOOKS - 1, OFFSET_VARIANCE), (LOOKS, SHARED * 0.4)):
        assert of_one_edge(0.4, times=times)[1] == pytest.approx([variance])
    assert of_one_edge(0.4, times=LOOKS, trusted=0.1)[1] == pytest.approx([SHARED * 0.4])


def test_one_bad_point_does_not_widen_the_offset_of_its_edge():
    three = np.array([1e-3, 1e-3, 1.0])
    assert of_one_edge(three)[1] == pytest.approx([SHARED * 1.5e-3], rel=1e-3)


def fitted_and_learned(rng, count, spread_px):
    """Mean squares learned from poses fitted to so many points of one part of an edge, and the poses' chi-squares.

    The pose is one shift along the normal: its error is the points' mean.
    """
    lines = SearchLines(np.zeros((count, 4)), np.zeros((count, 6)), np.ones(count, np.int64))
    lines.jacobian[:, 0] = 1.0
    appearance, rows, learned, squares = np.zeros((1, 8)), np.zeros(count, np.int64), [], []
    appearance[0, 6], appearance[0, 7] = 1.0, 1.0
    for _ in range(3000):
        found, covariance = rng.normal(0.0, spread_px, count), np.zeros((6, 6))
        covariance[0, 0] = appearance[0, 7] / count
        squares.append(found.mean() ** 2 / covariance[0, 0])
        learn_squares(lines, rows, found - found.mean(), covariance, appearance, kernel_values(AppearanceConfig()))
        appearance[:, 6] += 1
        learned.append(appearance[0, 7])
    return np.mean(learned[500:]), np.mean(squares[500:])


@pytest.mark.parametrize("count", [2, 3, 20])
def test_what_the_pose_follows_is_learned_too_and_the_covariance_is_consistent(count):
    """The residuals alone hold only 1 - 1 / count of the squares."""
    learned, square = fitted_and_learned(np.random.default_rng(1), count, 0.1)
    assert learned == pytest.approx(0.1**2, rel=0.08)
    assert 0.85 < square < 1.25


def test_a_point_that_is_not_found_or_not_known_learns_nothing():
    lines = SearchLines(np.zeros((2, 4)), np.zeros((2, 6)), np.ones(2, np.int64))
    appearance = np.zeros((2, 8))
    appearance[0, 6], appearance[:, 7] = 1.0, 0.3
    learn_squares(
        lines, np.arange(2), np.array([np.inf, 0.0]), np.eye(6), appearance, kernel_values(AppearanceConfig())
    )
    assert appearance[:, 7] == pytest.approx([0.3, 0.3])


def test_a_second_look_takes_the_place_of_what_was_assumed_of_an_edge():
    lines, nothing = SearchLines(np.zeros((1, 4)), np.zeros((1, 6)), np.ones(1, np.int64)), np.zeros((6, 6))
    appearance = np.zeros((1, 8))
    appearance[0, 6], appearance[0, 7] = 1.0, 1.0
    for times, residual, learned in ((1.0, 0.1, 0.01), (2.0, 0.3, (0.01 + 0.09) / 2)):
        appearance[0, 6] = times
        learn_squares(
            lines, np.zeros(1, np.int64), np.array([residual]), nothing, appearance, kernel_values(AppearanceConfig())
        )
        assert appearance[0, 7] == pytest.approx(learned)


def test_a_part_that_was_not_learned_looks_like_the_nearest_one_of_the_same_edge_that_was():
    appearance = np.zeros((24, 8))
    appearance[[2, 7, 16], 6] = 1.0  # parts 2 and 7 of the first edge, part 0 of the third
    parts = np.array([0, 2, 4, 6, 7, 8, 15, 23])
    assert known_rows(parts, appearance).tolist() == [2, 2, 2, 7, 7, 8, 15, 16]


def test_a_missed_part_of_a_known_edge_counts_as_much_as_its_other_parts():
    """Else the support of a pose depends on which parts of its edges it happens to see."""
    appearance = np.zeros((8, 8))
    appearance[0, 0], appearance[0, 6] = 100.0, 1.0
    points = ControlPoints(np.zeros((2, 3)), np.zeros((2, 3), np.int64), np.array([0, 5]), np.array([0, 2]))
    weak, weights = WEAK_STEP, kernel_values(WEIGHTS)
    own = contrast_weights(points.rows, appearance, weak, weights)
    counts = contrast_weights(known_rows(points.rows, appearance), appearance, weak, weights)
    found = Candidates(np.zeros((2, 1)), np.full((2, 1), 1000 * weak))
    lines = SearchLines(np.zeros((2, 4)), np.zeros((2, 6)), np.ones(2, np.int64))
    measured = EdgeMeasurements(points, lines, found, own, np.ones(2), np.zeros((2, 0)))
    nothing = np.zeros(0)
    for kept, share in (([1, 1], 1.0), ([1, 0], 0.5), ([0, 1], 0.5)):
        got = support(measured, counts, own * kept, nothing, nothing, appearance, weak)
        assert got.edges == pytest.approx(share * counts.sum() / max(1.0, counts.sum()), rel=1e-3)


def parallel_edges(across_px, starts_px, every_px, points, turned_rad=0.0):
    """Search lines of edges of so many control points, along x before they are turned, each at a height across_px."""
    lines = []
    for y, start in zip(across_px, starts_px, strict=True):
        x = start + every_px * np.arange(points)
        lines.append(np.column_stack([x, np.full(points, y), np.zeros(points), np.ones(points)]))
    lines = np.concatenate(lines)
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    turn = np.array([[c, -s], [s, c]])
    lines = np.column_stack([lines[:, :2] @ turn.T, lines[:, 2:] @ turn.T])
    first = np.arange(len(across_px) + 1) * points
    return SearchLines(lines, np.zeros((len(lines), 6)), np.ones(len(lines), np.int64)), first


@pytest.mark.parametrize("turned_rad", [0.0, 0.7, 1.6])
@pytest.mark.parametrize("every_px", [6.0, 55.0])
def test_edges_are_as_far_apart_as_their_lines_however_far_their_points_are(every_px, turned_rad):
    """Points of long edges lie far apart: those of a parallel one may all be farther away than that edge is."""
    at, first = parallel_edges([0.0, 3.0, 30.0], [0.0, every_px / 2, 0.0], every_px, 4, turned_rad)
    spacing = edge_spacing(at, first, 8.0)
    assert spacing == pytest.approx([3.0] * 8 + [8.0] * 4)


def test_an_edge_does_not_disturb_one_beyond_its_end():
    at, first = parallel_edges([0.0, 3.0], [0.0, 100.0], 6.0, 4)
    assert edge_spacing(at, first, 8.0) == pytest.approx([8.0] * 8)
    at, first = parallel_edges([0.0, 3.0], [0.0, 260.0], 55.0, 4)  # ends at 165 and 27 px beyond
    assert edge_spacing(at, first, 8.0) == pytest.approx([8.0] * 8)


def test_an_edge_across_does_not_disturb():
    at, first = parallel_edges([0.0, 3.0], [0.0, 0.0], 6.0, 4)
    at.lines[4:, 2:] = [1.0, 0.0]
    assert edge_spacing(at, first, 8.0) == pytest.approx([8.0] * 8)


def test_an_edge_a_part_of_which_is_hidden_reaches_no_farther_for_that():
    """Two of its points are 200 px apart since a tree hides what is between; the other edge is there, and sees none."""
    at, first = parallel_edges([0.0, 3.0], [0.0, 100.0], 6.0, 4)
    at.lines[1:4, 0] = [200.0, 206.0, 212.0]
    assert edge_spacing(at, first, 8.0) == pytest.approx([8.0] * 8)


def test_points_outside_the_image_and_edges_of_one_point_disturb_where_they_are_alone():
    at, first = parallel_edges([0.0, 3.0], [0.0, 0.0], 6.0, 4)
    at.side[5:] = OUTSIDE
    assert edge_spacing(at, first, 2.0) == pytest.approx([2.0] * 8)
    assert edge_spacing(at, first, 8.0) == pytest.approx([3.0, 3.0, 8.0, 8.0, 3.0, 8.0, 8.0, 8.0])
    alone, first = parallel_edges([0.0, 3.0], [0.0, 0.0], 6.0, 1)
    assert edge_spacing(alone, first, 8.0) == pytest.approx([3.0] * 2)
