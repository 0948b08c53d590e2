"""The pose of least distances to edges and patches, with the biases marginalized, against dense least squares."""

import numpy as np
import pytest

from uavbench.scenes.camera import Camera, camera_array
from uavbench.tracker.robust.config.solver import BiasConfig, EstimatorConfig
from uavbench.tracker.robust.edges.measurements import Candidates, ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.kernel_values import kernel_values
from uavbench.tracker.robust.patches.matches import PatchMatches
from uavbench.tracker.robust.solver.bias_state import ExpectedOffsets, FrameSums, KindSums, LocalBiases
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.equation_kernels import PosePrior
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.tracker.robust.solver.number_state import KnownNumbers
from uavbench.tracker.robust.solver.solve_kernels import refine
from uavbench.tracker.robust.solver.spread_kernels import Joint, weigh_edges
from uavbench.tracker.robust.solver.sum_kernels import EFFICIENT
from uavbench.tracker.robust.view import AT_ONCE, NOTHING_MASKED, View
from uavbench.trajectories.pose import Pose

EDGES, ON_EDGE, PATCHES, MOVED = 6, 3, 8, 3
CAMERA = Camera.from_field_of_view(640, 480, horizontal_deg=65.0)
ALIKE = EdgeKinds(np.array([0, 0, -1, 1, 1, 0]), np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0]), 2)
APART = EdgeKinds(np.full(EDGES, -1), np.ones(EDGES), 0)
LINEAR_PX, FINE_PX = 1e6, 1.5
"""A cutoff with which all weights are 1, so that one iteration is a linear least-squares solution; that of a fit."""


def jacobian(points):
    """Derivative (n, 2, 6) of the pixels of points for twists of a camera at the identity, by differences."""
    step = 1e-6
    columns = [
        (CAMERA.project(Pose.exp(step * e).transform(points)) - CAMERA.project(Pose.exp(-step * e).transform(points)))
        for e in np.eye(6)
    ]
    return np.stack(columns, axis=-1) / (2 * step)


def covariance_of(kinds, variance_px2, shared):
    """Prior covariance of the offsets, as it is meant: shared by those of a kind, apart from their signs."""
    alike = (kinds.kinds[:, None] == kinds.kinds) & (kinds.kinds >= 0)
    common = shared * np.outer(kinds.signs, kinds.signs) * alike
    return variance_px2 * (common + np.diag(np.where(kinds.kinds >= 0, 1 - shared, 1.0)))


def learn(biases, offsets, rng):
    """Let biases learn from a frame at the identity, whose patches leave no doubt about the pose."""
    edge = np.repeat(np.arange(EDGES), ON_EDGE)
    J, w = rng.normal(size=(len(edge), 6)) * 300, rng.uniform(20, 60, len(edge))
    r = rng.normal(0, 0.1, len(edge))
    S, d = np.bincount(edge, w), np.bincount(edge, w * r)
    s = np.array([w[edge == e] @ J[edge == e] for e in range(EDGES)])
    sums = FrameSums(S, s, d, (J.T * w) @ J, J.T @ (w * r), 1e18 * np.eye(6), np.zeros(6))
    biases.learn(offsets, sums, np.zeros(6), Pose.identity(), 0.5)


class Drawn:
    """Points of edges and patches drawn at random, what is known beforehand, and the same as dense equations.

    distances: number of candidates of a point, 1 of those that are located between the pixels; aside_px: shift of the
    points of one edge; learned: whether an earlier frame told of the offsets and of D.
    """

    def __init__(self, kinds, numbers, distances, aside_px=0.0, learned=False):
        rng, shared = np.random.default_rng(4), 0.6
        n = EDGES * ON_EDGE
        self.edge, self.numbers, identity = np.repeat(np.arange(EDGES), ON_EDGE), numbers, (np.eye(3), np.zeros(3))
        points, places = (np.column_stack([rng.uniform(-1, 1, (k, 2)), rng.uniform(3, 5, k)]) for k in (n, PATCHES))
        angles = rng.uniform(0, 2 * np.pi, EDGES)[self.edge]
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        self.residual, self.variance = rng.normal(0, 0.3, n), rng.uniform(0.01, 0.1, n)
        self.residual[self.edge == MOVED] += aside_px
        self.weight, self.moved = rng.uniform(0.2, 1.0, n), rng.normal(0, 1e-4, (PATCHES, 2))  # far from the cutoff
        patch_variance, prior = rng.uniform(0.01, 0.1, PATCHES), np.diag(rng.uniform(1e2, 1e3, 6))
        by_numbers, mean, root = (rng.normal(0, 0.2, size) for size in ((n, numbers), numbers, (numbers, numbers)))
        self.known = KnownNumbers(mean, root @ root.T)
        biases = NuisanceBiases(kinds, BiasConfig(), numbers, 0)
        offsets = biases.offsets(np.arange(EDGES), np.full(EDGES, 0.2**2), shared)
        if learned:
            learn(biases, offsets, rng)
        measured = EdgeMeasurements(
            ControlPoints(points, np.zeros((n, 3), np.int64), np.zeros(n, np.int64), np.arange(EDGES + 1) * ON_EDGE),
            SearchLines(np.column_stack([CAMERA.project(points), normals]), np.zeros((n, 6)), np.ones(n, np.int64)),
            Candidates(
                np.pad(self.residual[:, None], ((0, 0), (0, distances - 1)), constant_values=np.inf), np.ones((n, 2))
            ),
            self.weight,
            self.variance,
            by_numbers,
        )
        matches = PatchMatches(places, CAMERA.project(places) + self.moved, np.ones(PATCHES), patch_variance)
        size, bounds = np.array([640.0, 480.0]), np.array([-1.0, -1.0, 1.0, 1.0])
        view = View(*identity, camera_array(CAMERA), size, bounds, 0.1, NOTHING_MASKED, AT_ONCE)
        self.given = measured, matches, biases.seen_with(offsets), PosePrior(prior, *identity, self.known), view
        J = np.einsum("ni,nij->nj", normals, jacobian(points))
        self.of_points = np.concatenate([J, np.zeros((n, 6)), np.eye(EDGES)[self.edge], by_numbers], axis=1)
        K = jacobian(places).reshape(-1, 6)
        self.of_patches = np.concatenate([K, -K, np.zeros((2 * PATCHES, EDGES + numbers))], axis=1)
        self.patch_information = np.repeat(1 / patch_variance, 2)
        self.before = np.zeros((12 + EDGES + numbers,) * 2)
        self.before[:6, :6] = prior
        self.before[6:12, 6:12] = np.eye(6)  # what a fresh filter knows of the patches' pose error
        self.before[12 : 12 + EDGES, 12 : 12 + EDGES] = np.linalg.inv(covariance_of(kinds, 0.2**2, shared))
        self.told_before = np.zeros(len(self.before))
        if learned:
            self.add_learned(biases.state)

    def add_learned(self, state):
        """Add what the state of the biases holds: of D beside the unit information, of the offsets, and of both."""
        D, offsets = slice(6, 12), slice(12, 12 + EDGES)
        self.before[D, D] = state.information
        self.before[offsets, offsets] += np.diag(state.offset_information)
        self.before[offsets, D] = state.cross
        self.before[D, offsets] = state.cross.T
        self.told_before[D], self.told_before[offsets] = state.vector, state.offset_vector

    def fit(self, iterations):
        """The estimate after so many iterations."""
        return refine(*self.given, np.full(iterations, LINEAR_PX), kernel_values(EstimatorConfig()))

    def dense(self, weight):
        """Information and vector of pose, D, offsets and numbers, by weights (n,), before what is known of the last."""
        rows, information = (
            np.vstack([self.of_points, self.of_patches]),
            np.concatenate([weight / self.variance, self.patch_information]),
        )
        right = np.concatenate([self.residual, self.moved.ravel()])
        return (rows.T * information) @ rows + self.before, rows.T @ (information * right) + self.told_before

    def with_numbers(self, dense, whole):
        """The same, with what is known of the numbers."""
        at, inverse = slice(12 + EDGES, None), np.linalg.inv(self.known.covariance)
        dense, whole = dense.copy(), whole.copy()
        dense[at, at] += inverse
        whole[at] += inverse @ self.known.mean
        return dense, whole


@pytest.mark.parametrize(("numbers", "learned"), [(0, False), (0, True), (1, False), (2, False)])
@pytest.mark.parametrize("kinds", [APART, ALIKE])
def test_the_pose_and_its_information_are_those_of_the_whole_system(kinds, numbers, learned):
    drawn = Drawn(kinds, numbers, distances=2, learned=learned)
    found = drawn.fit(1)
    dense, whole = drawn.dense(drawn.weight)
    told = np.linalg.inv(np.linalg.inv(dense[: 12 + EDGES, : 12 + EDGES])[:6, :6])
    dense, whole = drawn.with_numbers(dense, whole)
    solution = np.linalg.solve(dense, whole)
    np.testing.assert_allclose(found.step.to_fit, solution[:6], rtol=1e-5)
    marginal = np.linalg.inv(np.linalg.inv(dense)[:6, :6])
    np.testing.assert_allclose(found.step.information, marginal, rtol=1e-4, atol=1e-4 * np.abs(marginal).max())
    np.testing.assert_allclose(found.step.told, told, rtol=1e-4, atol=1e-4 * np.abs(told).max())
    np.testing.assert_allclose(found.step.to_numbers, solution[12 + EDGES :], rtol=1e-5)
    np.testing.assert_allclose(Pose(found.R, found.t).matrix, Pose.exp(found.step.to_fit).matrix, atol=1e-12)


@pytest.mark.parametrize(("numbers", "learned"), [(0, False), (0, True), (1, False), (2, False)])
@pytest.mark.parametrize("kinds", [APART, ALIKE])
def test_an_edge_is_weighed_by_how_far_it_is_from_where_a_fit_without_its_mean_expects_that(kinds, numbers, learned):
    drawn = Drawn(kinds, numbers, distances=1, aside_px=-0.7, learned=learned)
    once, twice = drawn.fit(1), drawn.fit(2)
    np.testing.assert_array_equal(once.weighting.edge_weight, 1.0)
    by_numbers, deviations = drawn.of_points[:, 12 + EDGES :], []
    free, numbers_found = slice(12 + EDGES), once.step.to_numbers  # the numbers are as the fit of all found them
    information, vector = drawn.dense(once.weighting.weight)
    vector = vector[free] - information[free, 12 + EDGES :] @ numbers_found
    for e in range(EDGES):
        own = drawn.edge == e
        weight = once.weighting.weight[own] / drawn.variance[own]
        row = weight @ drawn.of_points[own, free] / weight.sum()
        mean = weight @ (drawn.residual[own] - by_numbers[own] @ numbers_found) / weight.sum()
        rest = np.linalg.inv(information[free, free] - weight.sum() * np.outer(row, row))
        away = mean - row @ rest @ (vector - weight.sum() * mean * row)
        deviations.append(away / np.sqrt(row @ rest @ row + 1 / weight.sum()))
    expected = np.maximum(0.0, 1 - (np.array(deviations) / EFFICIENT) ** 2) ** 2
    assert expected[MOVED] < 0.5 < np.delete(expected, MOVED).min()
    np.testing.assert_allclose(twice.weighting.edge_weight, expected, rtol=1e-4)
    assert (twice.weighting.weight <= expected[drawn.edge] * drawn.weight * (1 + 1e-4)).all()


def test_edges_keep_their_weights_where_a_fit_has_no_covariance():
    S, weight = np.array([40.0, 0.0]), np.array([1.0, 0.5])
    sums = FrameSums(S, np.ones((2, 6)), np.ones(2), np.eye(6), np.ones(6), np.eye(6), np.zeros(6))
    none = KindSums(np.zeros(0), np.zeros((0, 12)), np.zeros(0))
    offsets = np.zeros((2, 6)), np.ones(2), np.zeros(2), np.array([-1, -1]), np.zeros(2)
    biases = LocalBiases(np.eye(6), np.zeros(6), *offsets, none, ExpectedOffsets(np.zeros(2), np.ones(2)))
    weigh_edges(sums, biases, none, Joint(np.zeros(12), np.full((12, 12), np.nan)), np.empty(12), weight)
    assert weight.tolist() == [1.0, 0.5]
    weigh_edges(sums, biases, none, Joint(np.zeros(12), 1e-9 * np.eye(12)), np.empty(12), weight)
    assert 0.0 < weight[0] < 1.0
    assert weight[1] == 0.5


def weights_of_patches(points, moved_px, sigma_px):
    """Weights of patches that are found beside their places, after a fit to patches and so many edge points."""
    places = np.column_stack([np.linspace(-1, 1, PATCHES), np.linspace(-0.5, 0.5, PATCHES) ** 2, np.full(PATCHES, 4.0)])
    observed = CAMERA.project(places)
    observed[0] += moved_px
    identity, first = (np.eye(3), np.zeros(3)), np.array([0, points]) if points else np.zeros(1, np.int64)
    at = np.column_stack([np.linspace(-1, 1, points), np.ones(points), np.full(points, 4.0)])
    normals = np.tile([0.0, 1.0], (points, 1))
    measured = EdgeMeasurements(
        ControlPoints(at, np.zeros((points, 3), np.int64), np.zeros(points, np.int64), first),
        SearchLines(np.column_stack([CAMERA.project(at), normals]), np.zeros((points, 6)), np.ones(points, np.int64)),
        Candidates(np.zeros((points, 2)), np.ones((points, 2))),
        np.ones(points),
        np.full(points, 0.01),
        np.zeros((points, 0)),
    )
    biases = NuisanceBiases(EdgeKinds(np.full(3, -1), np.ones(3), 0), BiasConfig(), 0, 0)
    rows = np.arange(len(first) - 1)
    offsets = biases.offsets(rows, np.full(len(rows), 0.04**2), 0.5)
    view = View(
        *identity,
        camera_array(CAMERA),
        np.array([640.0, 480.0]),
        np.array([-1.0, -1.0, 1.0, 1.0]),
        0.1,
        NOTHING_MASKED,
        AT_ONCE,
    )
    found = refine(
        measured,
        PatchMatches(places, observed, np.ones(PATCHES), np.full(PATCHES, sigma_px**2)),
        biases.seen_with(offsets),
        PosePrior(1e8 * np.eye(6), *identity, KnownNumbers(np.zeros(0), np.zeros((0, 0)))),
        view,
        np.array([FINE_PX]),
        kernel_values(EstimatorConfig()),
    )
    return found.weighting.patch_weight


@pytest.mark.parametrize(("sigma_px", "kept"), [(0.15, False), (0.3, True)])
def test_a_patch_six_standard_deviations_beside_its_place_is_none_of_the_structure_once_edges_tell_the_pose(
    sigma_px, kept
):
    weights = weights_of_patches(10, 0.9 / np.sqrt(2), sigma_px)
    assert (weights[0] > 0) == kept
    assert (weights[1:] > 0.99).all()


def test_where_patches_alone_tell_the_pose_those_farther_away_count():
    assert weights_of_patches(0, 0.9 / np.sqrt(2), 0.15)[0] == pytest.approx((1 - 0.9**2 / FINE_PX**2) ** 2, rel=1e-3)
