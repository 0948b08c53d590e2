"""The scale of the reported covariance: by dense least squares, and by draws whose spread is known."""

import numpy as np
import pytest

from uavbench.scenes.camera import Camera
from uavbench.tracker.robust.config.solver import BiasConfig
from uavbench.tracker.robust.fit.unit_weight import PRIOR_VARIANCE, SHARED_PX, UnitWeight
from uavbench.tracker.robust.solver.bias_state import FrameSums
from uavbench.tracker.robust.solver.edge_kinds import EdgeKinds
from uavbench.tracker.robust.solver.nuisance_biases import NuisanceBiases
from uavbench.tracker.robust.solver.spread_kernels import Spread, edge_spread, moved_by

EDGES, KINDS, SHARED = 40, 5, 0.5
CAMERA = Camera.from_field_of_view(640, 480, horizontal_deg=65.0)


class Edges:
    """Edges of five kinds and some like no other: their Jacobians, and the covariance of their mean residuals."""

    def __init__(self, rng):
        kinds = rng.integers(-1, KINDS, EDGES)
        signs = rng.choice([-1.0, 1.0], EDGES)
        biases = NuisanceBiases(EdgeKinds(kinds, signs, KINDS), BiasConfig(), 0, 0)
        self.state = biases.state
        self.offsets = biases.offsets(np.arange(EDGES), rng.uniform(0.01, 0.09, EDGES), SHARED)
        self.jacobian, self.weight = rng.normal(0, 300, (EDGES, 6)), rng.uniform(20, 200, EDGES)
        alike = (kinds[:, None] == kinds) & (kinds >= 0)
        shared = self.offsets.kind_px2[:, None] * np.outer(signs, signs) * alike
        self.covariance = np.diag(self.offsets.variance_px2 + 1 / self.weight) + shared

    def fitted(self, residual):
        """Covariance of the pose that fits residuals (e,) best, and what is left of them."""
        inverse = np.linalg.inv(self.covariance)
        pose = np.linalg.inv(self.jacobian.T @ inverse @ self.jacobian)
        return pose, residual - self.jacobian @ (pose @ self.jacobian.T @ inverse @ residual)

    def sums(self, residual):
        return FrameSums(
            self.weight, self.weight[:, None] * self.jacobian, self.weight * residual,
            np.zeros((6, 6)), np.zeros(6), np.zeros((6, 6)), np.zeros(6),
        )  # fmt: skip

    def spread(self, pose, residual, located):
        first, steps = np.arange(EDGES + 1), located.astype(np.int64)
        return edge_spread(self.sums(residual), self.offsets, self.state, first, steps, np.zeros(0), pose)


@pytest.mark.parametrize("seed", range(4))
def test_the_spread_is_that_of_dense_matrices(seed):
    rng = np.random.default_rng(seed)
    edges, located = Edges(rng), rng.random(EDGES) < 0.7
    residual, pose = rng.normal(0, 0.3, EDGES), np.diag(rng.uniform(1e-8, 1e-6, 6))
    inverse = np.linalg.inv(edges.covariance[np.ix_(located, located)])
    r, J = residual[located], edges.jacobian[located]
    found = edges.spread(pose, residual, located)
    assert found.chi2 == pytest.approx(r @ inverse @ r, rel=1e-9)
    assert found.freedom == pytest.approx(located.sum() - np.trace(J @ pose @ J.T @ inverse), rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_displaced_edges_move_a_fit_as_by_dense_matrices(seed):
    rng = np.random.default_rng(seed)
    edges, displaced = Edges(rng), rng.normal(0, 0.3, EDGES)
    pose, _ = edges.fitted(displaced)
    moved = moved_by(edges.sums(np.zeros(EDGES)), edges.offsets, edges.state, displaced, pose)
    expected = pose @ edges.jacobian.T @ np.linalg.solve(edges.covariance, displaced)
    assert moved == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("true_scale", [0.25, 1.0, 9.0])
def test_the_scale_is_that_of_the_residuals_that_were_drawn(true_scale):
    rng = np.random.default_rng(7)
    edges, weight = Edges(rng), UnitWeight(rate=0.1)
    root, chi2, freedom = np.linalg.cholesky(true_scale * edges.covariance), 0.0, 0.0
    for _ in range(300):
        pose, left = edges.fitted(root @ rng.normal(size=EDGES))
        spread = edges.spread(pose, left, np.ones(EDGES, bool))
        chi2, freedom = chi2 + spread.chi2, freedom + spread.freedom
    assert freedom == pytest.approx(300 * (EDGES - 6), rel=1e-9)
    assert chi2 / freedom == pytest.approx(true_scale, rel=0.05)  # 300 frames of 34: a deviation of 1.4 %
    weight.spread = Spread(chi2, freedom)
    assert weight.variance == pytest.approx(true_scale, rel=0.06)


def test_few_edges_change_little_and_an_image_shares_a_shift():
    few, many = UnitWeight(0.1, Spread(0.9, 3.0)), UnitWeight(0.1, Spread(27.0, 90.0))
    assert PRIOR_VARIANCE < few.variance < 1.1 * PRIOR_VARIANCE
    assert 0.3 < many.variance < 0.4
    of_fit = np.diag([1e-6, 1e-6, 1e-6, 1e-12, 1e-12, 1e-12])
    reported = many.covariance(of_fit, CAMERA, np.zeros(6))
    turned = (CAMERA.fx * np.sqrt(np.diag(reported - many.variance * of_fit)[3:])).round(9)
    assert turned.tolist() == pytest.approx([SHARED_PX * CAMERA.fx / CAMERA.fy, SHARED_PX, 0.0])


def test_what_is_not_known_of_the_blur_counts_along_the_motion_that_it_makes():
    by_codes = np.array([1e-3, -2e-3, 4e-3, 1e-4, 3e-4, -2e-4])
    of_fit, weight = np.diag([1e-6, 1e-6, 1e-6, 1e-9, 1e-9, 1e-9]), UnitWeight(0.1)
    more = weight.covariance(of_fit, CAMERA, by_codes) - weight.covariance(of_fit, CAMERA, np.zeros(6))
    part = np.random.default_rng(3).uniform(size=200_000)  # any part of the blur is as likely
    drawn = np.square(part).mean() * np.outer(by_codes, by_codes)
    assert more == pytest.approx(drawn, rel=0.01)
