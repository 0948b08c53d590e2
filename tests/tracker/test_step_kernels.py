"""Blurred steps of light are found between the pixels, edges that crowd too, and the fit knows how well."""

import math

import numpy as np
import pytest
from scipy.special import erf

from uavbench.scenes.rendering.radiance import encode
from uavbench.tracker.robust.config.edges import SubpixelConfig
from uavbench.tracker.robust.edges.measurements import ControlPoints, SearchLines
from uavbench.tracker.robust.edges.neighbour_kernels import neighbouring_edges
from uavbench.tracker.robust.edges.profile_fit_kernels import INITIAL_BLUR_PX, MOST_STEPS, fit_steps, workspace
from uavbench.tracker.robust.edges.step_kernels import CROWDED_PX, FittedPoints, learned_light, refine_subpixel
from uavbench.tracker.robust.kernel_values import kernel_values

SIZE, FINE = 41, 8
MIDDLE = SIZE // 2
DARK, BRIGHT = np.array([0.05, 0.08, 0.12]), np.array([0.5, 0.45, 0.4])
OFFSETS_PX = 0.1
FOUND_PX2 = 0.2**2


def edges(distances, angle_deg, levels=(0.0, 1.0), noise=0.0, rng=None, blur_px=INITIAL_BLUR_PX):
    """Image of stripes that begin so many px beyond the middle along a normal, of levels from dark 0 to bright 1."""
    nu, nv = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    at = (np.arange(SIZE * FINE) + 0.5) / FINE - 0.5
    across = (at[None, :] - MIDDLE) * nu + (at[:, None] - MIDDLE) * nv
    lens = math.sqrt(blur_px**2 - 1 / 12)  # the rest of the blur is that of the pixels' area
    share = np.full(across.shape, levels[0])
    for distance, low, high in zip(distances, levels[:-1], levels[1:], strict=True):
        share += (high - low) * 0.5 * (1 + erf((across - distance) / (math.sqrt(2) * lens)))
    share = share.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))[..., None]
    codes = encode(DARK * (1 - share) + BRIGHT * share).astype(float)
    codes += rng.normal(0, noise, codes.shape) if rng is not None else 0.0
    return np.clip(np.rint(codes), 0, 255).astype(np.uint8), np.array([MIDDLE, MIDDLE, nu, nv], dtype=float)


def appearance():
    row = np.zeros(8)
    row[:3], row[3:6], row[6] = encode(DARK[None, None])[0, 0], encode(BRIGHT[None, None])[0, 0], 5
    return row


def fit(image, line, *expected, along=2):
    """The step expected so far along a line, fitted together with others; its distance from the line, and variance."""
    colour, work = np.empty(3), workspace(MOST_STEPS, INITIAL_BLUR_PX)
    learned_light(appearance(), 3, colour)
    for k, distance in enumerate(expected):
        work.lines[k] = [line[0] + distance * line[2], line[1] + distance * line[3], line[2], line[3]]
        work.apart_px2[k] = OFFSETS_PX**2
    found, variance = fit_steps(image, len(expected), along, colour, work)
    return expected[0] + found, variance


@pytest.mark.parametrize("angle", [0, 20, 45, 70, 90, 135, 200, 310])
@pytest.mark.parametrize("distance", [-0.4, -0.1, 0.0, 0.3])
def test_a_step_is_found_to_a_hundredth_of_a_pixel(angle, distance):
    image, line = edges([distance], angle)
    found, variance = fit(image, line, 0.0)
    assert found == pytest.approx(distance, abs=0.06)
    assert 0 < variance < 0.03**2
    assert fit(image, line, found)[0] == pytest.approx(distance, abs=0.012)


@pytest.mark.parametrize("angle", [0, 25, 90, 250])
@pytest.mark.parametrize("gap", [1.2, 1.5, 2.5, 4.0])
@pytest.mark.parametrize("levels", [(0.0, 0.5, 1.0), (0.2, 1.0, 0.4), (0.5, 0.0, 0.7)])
def test_steps_that_crowd_are_found_together(angle, gap, levels):
    """The rails, reveals and flanges of a structure: alone a step is found beside its place by parts of a pixel."""
    image, line = edges([0.05, 0.05 + gap], angle, levels)
    for own, other in ((0.0, gap), (gap, 0.0)):
        found, variance = fit(image, line, own, other)
        assert found == pytest.approx(own + 0.05, abs=0.04)
        assert 0 < variance < OFFSETS_PX**2


def test_a_step_is_found_wrong_where_its_neighbours_are_not_known():
    image, line = edges([0.0, 1.5], 0, (0.0, 0.5, 1.0))
    assert abs(fit(image, line, 0.0)[0]) > 0.2


def test_edges_too_close_to_tell_apart_tell_where_both_are():
    image, line = edges([0.1, 0.6], 30, (0.0, 0.5, 1.0), 3.0, np.random.default_rng(3))
    (one, _), (two, _) = fit(image, line, 0.0, 0.5), fit(image, line, 0.5, 0.0)
    assert (one + two) / 2 == pytest.approx(0.35, abs=0.08)


def test_an_edge_that_is_not_seen_does_not_tell_again_what_its_neighbour_tells():
    image, line = edges([1.5], 0, (0.0, 1.0), 3.0, np.random.default_rng(2))
    seen, unseen = fit(image, line, 1.5, 0.0)[1], fit(image, line, 0.0, 1.5)[1]
    assert unseen > 10 * seen


@pytest.mark.parametrize("expected", [(0.1,), (0.1, 1.6)])
def test_its_variance_is_that_of_its_error(expected):
    rng = np.random.default_rng(0)
    levels = (0.0, 1.0) if len(expected) == 1 else (0.0, 0.6, 1.0)
    fits = []
    for _ in range(100):
        image, line = edges(expected, rng.uniform(0, 360), levels, 3.0, rng)
        fits.append(fit(image, line, *expected))
    found, variance = np.transpose(fits)
    assert 0.5 < np.mean((found - 0.1) ** 2 / variance) < 1.6


def test_a_longer_strip_tells_more():
    image, line = edges([0.1], 20, (0.0, 1.0), 3.0, np.random.default_rng(1))
    assert fit(image, line, 0.1, along=10)[1] < 0.4 * fit(image, line, 0.1, along=2)[1]


def test_no_step_is_found_where_there_is_none_or_it_goes_the_other_way():
    image, line = edges([0.0], 30)
    assert fit(np.full_like(image, 90), line, 0.0)[0] == np.inf
    assert fit(np.full_like(image, 90), line, 0.0, 1.5)[0] == np.inf
    assert fit(image, line * np.array([1, 1, -1, -1]), 0.0)[0] == np.inf
    assert fit(image, np.array([1.0, 1.0, 1.0, 0.0]), 0.0)[0] == np.inf


@pytest.mark.parametrize("blur_px", [0.33, 0.6, 0.8])
def test_the_blur_of_an_image_is_learned_from_edges_alone(blur_px):
    """A wrong one leaves an edge alone in its place, but moves those that crowd."""
    image, _ = edges([0.05], 20, blur_px=blur_px)
    line = edges([0.05], 20)[1]
    points, lines = points_of((MIDDLE, [(MIDDLE, 8)]))
    lines.lines[0] = line
    believed = INITIAL_BLUR_PX
    for _ in range(5):
        found = refined(image, points, lines, believed, 0.0)
        believed = found.blur_px
        assert found.distance[0, 0] == pytest.approx(0.05, abs=0.02)
    assert believed == pytest.approx(blur_px, abs=0.04)


def test_more_edges_than_a_profile_can_tell_apart_are_left_as_they_were_found():
    image, _ = edges([0.0, 1.0, 2.0, 3.0], 0, (0.0, 0.5, 0.2, 1.0, 0.6))
    points, lines = points_of(*((MIDDLE + k, [(MIDDLE, 8)]) for k in range(4)))
    assert refined(image, points, lines).steps.tolist() == [0, 0, 0, 0]


def points_of(*places):
    """Control points on vertical edges: of each edge the place u, and v and half length of its points."""
    edge = np.concatenate([np.full(len(pieces), e) for e, (_, pieces) in enumerate(places)])
    first = np.cumsum([0, *(len(pieces) for _, pieces in places)])
    v, half = np.array([piece for _, pieces in places for piece in pieces], dtype=float).T
    n = len(edge)
    lines = np.column_stack([[places[e][0] for e in edge], v, np.ones(n), np.zeros(n)])
    keys = np.column_stack([edge, np.ones(n), np.zeros(n)]).astype(np.int64)
    points = ControlPoints(np.zeros((n, 3)), keys, np.zeros(n, np.int64), first, half.copy())
    return points, SearchLines(lines, np.zeros((n, 6)), np.ones(n, np.int64))


def test_the_neighbours_of_a_point_are_the_edges_that_its_normal_meets():
    """However far the nearest control point of such an edge is: points may be 40 px apart."""
    points, lines = points_of(
        (10.0, [(20, 5)]), (12.0, [(38, 20)]), (9.0, [(60, 10)]), (13.5, [(20, 2)]), (19.0, [(20, 5)])
    )
    near = neighbouring_edges(points, lines, CROWDED_PX)
    assert near.rows[0].tolist() == [1, 3, -1]
    assert near.across_px[0, :2] == pytest.approx([2.0, 3.5])
    assert near.rows[2].tolist() == [-1, -1, -1]
    assert near.rows[3].tolist() == [1, 0, -1]
    assert near.across_px[3, :2] == pytest.approx([-1.5, -3.5])
    turned = lines._replace(lines=lines.lines.copy())
    turned.lines[1, 2:] = [0.0, 1.0]
    assert neighbouring_edges(points, turned, CROWDED_PX).rows[0].tolist() == [3, -1, -1]


def test_a_crowded_control_point_is_refined_with_its_neighbours():
    image, _ = edges([0.05, 1.65], 0, (0.0, 0.5, 1.0))
    points, lines = points_of((MIDDLE, [(MIDDLE, 8)]), (MIDDLE + 1.6, [(MIDDLE, 8)]))
    found = refined(image, points, lines)
    assert found.steps.tolist() == [2, 2]
    assert found.distance[:, 0] == pytest.approx([0.05, 0.05], abs=0.04)
    assert (found.variance_px2 < FOUND_PX2).all()


def refined(image, points, lines, blur_px=INITIAL_BLUR_PX, off=0.8):
    """What is fitted where a search found everything so far off: two steps as one, between them."""
    n = len(points.keys)
    fitted = FittedPoints(np.full(n, off), np.ones(n), np.full(n, FOUND_PX2), np.full(n, OFFSETS_PX**2), blur_px)
    near = neighbouring_edges(points, lines, CROWDED_PX)
    values = kernel_values(SubpixelConfig())
    return refine_subpixel(image, lines, points, near, appearance()[None], fitted, values)
