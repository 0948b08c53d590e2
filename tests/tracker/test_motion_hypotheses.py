"""Hypotheses of the camera motion: enough of them are drawn to find it among wrong candidates, and no more."""

import numpy as np
import pytest

from uavbench.tracker.robust.edges.measurements import Candidates, ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.solver.hypothesis_kernels import DRAWS_PER_EDGE, EDGES_DRAWN, HYPOTHESES, best_motion

EDGES, ON_EDGE, OUTLIER_PX, NOISE_PX = 12, 8, 3.0, 0.1
PRIOR = 1e-6 * np.eye(6)
MOTION = np.array([3.0, -2.0, 1.5, -4.0, 2.5, 1.0])


def draws(seed):
    return np.random.default_rng(seed).random((HYPOTHESES, EDGES_DRAWN * DRAWS_PER_EDGE))


def measured(wrong, seed):
    """Edges whose points have one candidate where the motion takes them and so many wrong ones up to 20 px away."""
    rng, n = np.random.default_rng([wrong, seed]), EDGES * ON_EDGE
    middle, along = (np.repeat(rng.normal(size=(EDGES, 6)), ON_EDGE, 0) for _ in range(2))
    jacobian = middle + np.tile(np.linspace(-1.0, 1.0, ON_EDGE), EDGES)[:, None] * along
    right = jacobian @ MOTION + NOISE_PX * rng.normal(size=n)
    distance = rng.permuted(np.c_[right, right[:, None] + rng.uniform(-20.0, 20.0, (n, wrong))], axis=1)
    rows = np.arange(n)
    first = np.arange(0, n + 1, ON_EDGE)
    return EdgeMeasurements(
        ControlPoints(np.zeros((n, 3)), np.zeros((n, 3), dtype=np.int64), rows, first),
        SearchLines(np.zeros((n, 4)), jacobian, np.zeros(n, dtype=np.int64)),
        Candidates(distance, np.ones(distance.shape)),
        np.ones(n),
        np.ones(n),
        np.zeros((n, 0)),
    )


@pytest.mark.parametrize(("wrong", "least"), [(0, 40), (1, 40), (3, 34)])
def test_the_motion_is_found_among_wrong_candidates(wrong, least):
    right = 0
    for seed in range(40):
        given = measured(wrong, seed)
        off_px = given.lines.jacobian @ (best_motion(given, PRIOR, draws(seed), OUTLIER_PX) - MOTION)
        right += int(np.median(np.abs(off_px)) < 0.5 * OUTLIER_PX)
    assert right >= least, "of 40"


def test_what_hardly_a_better_hypothesis_can_follow_ends_the_search():
    few, many = draws(5)[:16], draws(5)
    once = best_motion(measured(0, 1), PRIOR, few, OUTLIER_PX)
    np.testing.assert_array_equal(best_motion(measured(0, 1), PRIOR, many, OUTLIER_PX), once)
    among = measured(3, 1)
    assert not np.array_equal(best_motion(among, PRIOR, few, OUTLIER_PX), best_motion(among, PRIOR, many, OUTLIER_PX))
