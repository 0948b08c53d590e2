"""The covariance of a fit to a model that is not exact: edges displaced alike, or each by a variance of its own."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.tracker.synthetic import BOX_TRIANGLES, CAMERA, Scene, box_corners, look_at
from uavbench.scenes.structure import Structure
from uavbench.tracker.robust.fit.unit_weight import UnitWeight
from uavbench.tracker.robust.solver.bias_state import EdgeOffsets, FrameSums
from uavbench.tracker.robust.tracker import Robust

EDGES, DRAWS, WEIGHT = 60, 200, 1e6


class Fits:
    """Fits to edges that are displaced by so many px, with variances that are assumed to be others."""

    def __init__(self, displaced_px, assumed_px, seed=5):
        self.rng = np.random.default_rng(seed)
        self.displaced_px, self.assumed_px2 = displaced_px, assumed_px**2
        self.jacobian = self.rng.normal(0, 300, (EDGES, 6))

    def nees(self, more):
        """Mean NEES per degree of freedom of fits, with what `UnitWeight.displaced` adds to the covariance or not."""
        J, weight, total = self.jacobian, UnitWeight(rate=0.1), 0.0
        information = J.T / self.assumed_px2
        pose = np.linalg.inv(information @ J)
        for _ in range(DRAWS):
            offsets = self.displaced_px * self.rng.normal(size=EDGES)
            off = pose @ information @ offsets
            covariance = pose + (weight.displaced(self.fit(offsets - J @ off, pose)) if more else 0.0)
            total += off @ np.linalg.solve(covariance, off) / 6
        return total / DRAWS

    def fit(self, residual, pose):
        """What is read of a fit: the sums of its edges, each of one located point, and its covariance."""
        S, none = np.full(EDGES, WEIGHT), np.zeros(0)
        sums = FrameSums(S, S[:, None] * self.jacobian, S * residual, np.eye(6), np.zeros(6), np.eye(6), np.zeros(6))
        edges = EdgeOffsets(np.arange(EDGES), self.assumed_px2, np.zeros(EDGES))
        points, step = SimpleNamespace(first=np.arange(EDGES + 1)), SimpleNamespace(to_numbers=none)
        steps = np.ones(EDGES, dtype=np.int64)
        return SimpleNamespace(
            residuals=SimpleNamespace(points=points, steps=steps, step=step, sums=sums, edges=edges), covariance=pose
        )


def test_edges_that_are_displaced_alike_tell_no_more_where_a_fit_believes_them():
    """Half of them are thought to be exact, since the fit followed them."""
    believed = np.where(np.arange(EDGES) < EDGES // 2, 0.03, 0.5)
    fits = Fits(np.full(EDGES, 0.5), believed)
    assert fits.nees(more=False) > 50
    assert 0.7 < fits.nees(more=True) < 1.5


@pytest.mark.parametrize("seed", range(3))
def test_edges_of_variances_of_their_own_change_little(seed):
    own_px = 10.0 ** np.random.default_rng(seed).uniform(-2.5, 0, EDGES)
    fits = Fits(own_px, own_px, seed)
    assert fits.nees(more=True) == pytest.approx(1.0, abs=0.15)


def test_a_fit_without_located_edges_is_as_certain():
    fits = Fits(np.full(EDGES, 0.5), np.full(EDGES, 0.1))
    fit = fits.fit(np.full(EDGES, 0.5), np.eye(6))
    fit.residuals.steps[:] = 0
    assert not UnitWeight(rate=0.1).displaced(fit).any()
    assert not UnitWeight(rate=0.1).displaced(SimpleNamespace(residuals=None)).any()


def test_a_result_has_it(monkeypatch):
    size = (0.4, 0.3, 0.35)
    image = Scene([box_corners(size)], seed=2).render(pose := look_at(np.array([-0.7, -0.9, 0.6]), (0, 0, 0.15)))
    box, more = Structure.from_mesh(box_corners(size), BOX_TRIANGLES), 1e-3 * np.eye(6)
    told = []
    for added in (np.zeros((6, 6)), more):
        monkeypatch.setattr(UnitWeight, "displaced", lambda *_, added=added: added)
        told.append(Robust().start(box, CAMERA, pose, np.random.default_rng(0)).track(image, 0).covariance)
    assert told[1] - told[0] == pytest.approx(more, rel=1e-9)
