"""Rounded borders: where their edges are seen, and how well their radius is learned."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tests.tracker.synthetic import CAMERA
from tests.tracker.test_nuisance_biases import SURE
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.edges.columns import BOTH_FACES, EDGE, FACES
from uavbench.tracker.robust.edges.edge_graph import EdgeMap
from uavbench.tracker.robust.edges.rounding_kernels import derivatives, motion_by_radius, move
from uavbench.tracker.robust.edges.sampling_kernels import sample_edges, search_lines
from uavbench.tracker.robust.fit.shared_numbers import IS_ROUNDED, SIGMA, SharedNumbers
from uavbench.tracker.robust.optics.mixture_kernels import Slabs, mixture
from uavbench.tracker.robust.solver.bias_state import FrameSums
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.equation_kernels import PosePrior
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.tracker.robust.solver.number_kernels import numbers_seen
from uavbench.tracker.robust.view import View
from uavbench.trajectories.pose import Pose

RADIUS_M = 1e-3
CORNERS = np.array(list(product([-0.2, 0.2], [-0.15, 0.15], [0.0, 0.3])))
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX = Structure.from_mesh(CORNERS, np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))]), 1.0)


def seen_box(rng):
    """The edges of a box, a view of it, its control points and their motion by the radius."""
    edges, eye = EdgeMap.of(BOX, 35.0), rng.normal(size=3)
    eye *= rng.uniform(0.9, 1.5) / np.linalg.norm(eye)
    z = (np.array([0.0, 0.0, 0.15]) - eye) / np.linalg.norm(np.array([0.0, 0.0, 0.15]) - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    R = np.stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z])
    view = View.of(CAMERA, BOX).at(Pose(R, -R @ eye))
    points = sample_edges(edges, view, 8.0, 200)
    return edges, view, points, motion_by_radius(points, edges, view), eye


def border(edges, key):
    """Direction of a border, the normals of its faces, and its axis relative to the border for a unit of the radius."""
    along = edges.ends[key[EDGE], 1] - edges.ends[key[EDGE], 0]
    one, other = edges.planes[edges.faces[key[EDGE]], :3]
    return along / np.linalg.norm(along), one, other, -(one + other) / (1 + one @ other)


@pytest.mark.parametrize("seed", range(5))
def test_the_line_of_sight_to_a_silhouette_touches_the_rounding(seed):
    edges, _, points, motion, eye = seen_box(np.random.default_rng(seed))
    silhouettes = np.flatnonzero(points.keys[:, FACES] != BOTH_FACES)
    assert len(silhouettes) > 10
    for p in silhouettes:
        along, _, _, axis = border(edges, points.keys[p])
        ray = points.points[p] + RADIUS_M * motion[p] - eye
        across = np.cross(along, ray)
        apart = (points.points[p] + RADIUS_M * axis - eye) @ across / np.linalg.norm(across)
        assert abs(apart) == pytest.approx(RADIUS_M, rel=5e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_crease_is_seen_in_the_middle_of_its_rounding(seed):
    edges, _, points, motion, _ = seen_box(np.random.default_rng(seed))
    for p in np.flatnonzero(points.keys[:, FACES] == BOTH_FACES):
        _, one, other, axis = border(edges, points.keys[p])
        np.testing.assert_allclose(motion[p], axis + (one + other) / 2, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_how_points_move_in_the_image_is_told_with_them(seed):
    edges, view, points, motion, _ = seen_box(np.random.default_rng(seed))
    before = search_lines(points, edges.ends, edges.inward, view)
    told = derivatives(before, motion, 2.0, view)
    move(points, motion, 2e-5)
    after = search_lines(points, edges.ends, edges.inward, view)
    moved = ((after.lines - before.lines)[:, :2] * before.lines[:, 2:]).sum(axis=1)
    np.testing.assert_allclose(told * 1e-5, moved, rtol=1e-4, atol=1e-9)


def test_borders_that_recede_stay_sharp():
    inside_out = Structure.from_mesh(BOX.vertices * [5, 5, 20], BOX.triangles[:, ::-1], 1.0)
    edges = EdgeMap.of(inside_out, 35.0)
    view = View.of(CAMERA, inside_out).at(Pose(np.eye(3), np.array([0.2, 0.3, -0.5])))
    points = sample_edges(edges, view, 8.0, 200)
    assert len(points.points) > 10
    assert not motion_by_radius(points, edges, view).any()


def test_the_posterior_is_that_of_all_cases():
    rng = np.random.default_rng(3)
    root, vector, chances = rng.normal(size=(3, 3)) * 3, rng.normal(size=3) * 4, (0.4, 0.2)
    information, odds, means, squares = root @ root.T, [], [], []
    for case in product((0, 1), repeat=2):
        on = np.array([case[0], case[0], case[1]], dtype=bool)
        covariance = np.zeros((3, 3))
        covariance[np.ix_(on, on)] = np.linalg.inv(information[np.ix_(on, on)] + np.eye(on.sum()) / SIGMA**2)
        mean = covariance @ vector
        scale = np.linalg.det(covariance[np.ix_(on, on)]) / SIGMA ** (2 * on.sum())
        prior = np.prod([c if yes else 1 - c for c, yes in zip(chances, case, strict=True)])
        odds.append(prior * np.sqrt(scale) * np.exp(vector @ mean / 2))
        means.append(mean)
        squares.append(covariance + np.outer(mean, mean))
    weights = np.array(odds) / np.sum(odds)
    found = mixture(information, vector, Slabs(np.array([0, 2, 3]), np.array(chances), np.zeros(2, dtype=bool)), SIGMA)
    np.testing.assert_allclose(found.mean, weights @ means)
    square = np.tensordot(weights, squares, 1)
    np.testing.assert_allclose(found.covariance, square - np.outer(found.mean, found.mean), atol=1e-12)
    np.testing.assert_allclose(found.probability, [weights[2] + weights[3], weights[1] + weights[3]])


@pytest.mark.parametrize("told", [0.0, 2.0, 4.0])
def test_of_a_decided_group_the_likelier_case_counts_alone(told):
    """What may be there, and is not likely, adds nothing to what is uncertain; the other group stays a mixture."""
    information, vector, chances = np.diag([4.0, 30.0]), np.array([1.0, told * 5.0]), np.array([0.5, 0.02])
    first = np.array([0, 1, 2])
    both = mixture(information, vector, Slabs(first, chances, np.zeros(2, dtype=bool)), SIGMA)
    found = mixture(information, vector, Slabs(first, chances, np.array([False, True])), SIGMA)
    np.testing.assert_allclose(found.probability, both.probability)
    np.testing.assert_allclose([found.mean[0], found.covariance[0, 0]], [both.mean[0], both.covariance[0, 0]])
    rounded = both.probability[1] > 0.5
    assert rounded == (told == 4.0)
    variance = 1.0 / (30.0 + SIGMA**-2) if rounded else 0.0
    assert found.covariance[1, 1] == pytest.approx(variance)
    assert found.mean[1] == pytest.approx(variance * vector[1])


def learned(radius, frames=30, edges=40, sigma_px=0.05):
    """What frames of a camera of told response say of a radius, in units, of edges with offsets of their own."""
    rng, information = np.random.default_rng(5), 4e4
    numbers = SharedNumbers(replace(CAMERA, response="srgb"), 3.0, BiasConfig())
    kinds = EdgeKinds(np.full(edges, -1), np.ones(edges), 0)
    biases = NuisanceBiases(kinds, BiasConfig(), numbers.count, len(numbers.slabs.probability))
    offsets = rng.normal(size=edges) * sigma_px
    view = View.of(CAMERA, BOX).at(Pose(np.eye(3), np.zeros(3)))
    for _ in range(frames):
        J = np.column_stack([rng.normal(size=(edges, 6)) * 300, np.zeros(edges), rng.uniform(0.0, 1.0, edges)])
        residual = J[:, :6] @ rng.normal(size=6) * 1e-4 + J[:, -1] * (radius - numbers.at[-1]) + offsets
        w = np.full(edges, information)
        sums = FrameSums(w, w[:, None] * J, w * residual, (J.T * w) @ J, J.T @ (w * residual), SURE, np.zeros(6))
        seen = biases.before(biases.offsets(np.arange(edges), np.full(edges, sigma_px**2), 0.0))
        prior = PosePrior(np.eye(6), view.R, view.t, numbers.known)
        numbers.learn(numbers_seen(sums, seen, prior, view, sigma_px**2, numbers.slabs.first[:-1]), 1.0)
        numbers.locate()
    return numbers


@pytest.mark.parametrize("radius", [0.3, 0.6])
def test_a_radius_is_learned_from_how_it_displaces_edges(radius):
    numbers = learned(radius)
    sigma = float(np.sqrt(numbers.posterior.covariance[-1, -1]))
    assert numbers.posterior.probability[-1] > 0.99
    assert sigma < 0.1
    assert numbers.posterior.mean[-1] == pytest.approx(radius, abs=3 * sigma)
    assert numbers.rounding.radius_m == pytest.approx(0.03 * radius, abs=0.09 * sigma + 6e-4)


def test_what_is_sharp_stays_sharp():
    numbers = learned(0.0)
    assert numbers.posterior.probability[-1] < IS_ROUNDED
    assert abs(numbers.posterior.mean[-1]) < 1e-3
    assert numbers.rounding.radius_m == 0.0
