"""The compiled loops of the published method against the same said in numpy."""

import numpy as np
import pytest

from uavbench.tracker.shang_shen.control_points import ControlPoints
from uavbench.tracker.shang_shen.edge_search import MAX_CANDIDATES, search_segments
from uavbench.tracker.shang_shen.kernels import cheapest, twists_of


@pytest.mark.parametrize("seed", range(4))
def test_crossings_are_those_of_the_lines(seed):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0, 2 * np.pi, 20)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    points = ControlPoints(np.zeros((20, 3)), rng.uniform(0, 100, (20, 2)), normals, np.zeros(20, dtype=np.int64))
    segments = rng.uniform(0, 100, (60, 4))
    found = search_segments(points, segments, 20.0, 40.0).distances
    for i in range(20):
        wanted = []
        for x0, y0, x1, y1 in segments:
            along = np.array([x1 - x0, y1 - y0])
            if abs(along @ normals[i]) / np.linalg.norm(along) >= np.sin(np.radians(40.0)):
                continue
            d, s = np.linalg.solve(np.column_stack([normals[i], -along]), [x0, y0] - points.pixels[i])
            if abs(d) <= 20.0 and 0 <= s <= 1:
                wanted.append(d)
        wanted = sorted(wanted, key=abs)[:MAX_CANDIDATES]
        assert found[i, : len(wanted)] == pytest.approx(wanted, rel=1e-9)
        assert np.isinf(found[i, len(wanted) :]).all()


def test_the_cheapest_twist_is_the_one_of_least_cost():
    rng = np.random.default_rng(1)
    J, twists, extra = rng.normal(size=(30, 6)), rng.normal(size=(50, 6)), rng.uniform(0, 3, 50)
    distances = np.sort(rng.normal(0, 3, (30, 4)), axis=1)
    distances[::3, 2:] = np.inf
    distances[::5] = np.inf
    error = np.minimum(np.abs((twists @ J.T)[:, :, None] - distances).min(axis=2), 1.0)
    assert cheapest(twists, extra, J, distances, 1.0) == np.argmin((error**2).sum(axis=1) + extra)


def test_twists_solve_the_normal_equations():
    rng = np.random.default_rng(2)
    J, prior, rows = rng.normal(size=(30, 6)), np.diag(rng.uniform(0.1, 2, 6)), rng.integers(0, 30, (8, 6))
    wanted, out = rng.normal(size=(8, 6)), np.zeros((8, 6))
    twists_of(rows, wanted, J, prior, out)
    for h in range(8):
        A = J[rows[h]]
        assert A.T @ A @ out[h] + prior @ out[h] == pytest.approx(A.T @ wanted[h], abs=1e-9)
