"""How far each control point is trusted, and how much it errs."""

import numpy as np
import pytest

from uavbench.tracker.robust.config.edges import AppearanceConfig, WeightConfig
from uavbench.tracker.robust.edges.measurements import Candidates, ControlPoints, EdgeMeasurements, SearchLines
from uavbench.tracker.robust.edges.weight_kernels import offset_variances, point_variances
from uavbench.tracker.robust.kernel_values import kernel_values

WEIGHTS = WeightConfig()
WEAK_STEP = AppearanceConfig().weak_step_grey
OWN_VARIANCE = WEIGHTS.point_variance_px2
SILHOUETTE_VARIANCE, CREASE_VARIANCE = WEIGHTS.silhouette_variance_px2, WEIGHTS.crease_variance_px2


def of_one_edge(learned, *, times=1.0, side=1, distance=0.2, contrast=50.0, trusted=1.0):
    """Variances of three control points of one edge, whose appearance was learned so many times."""
    n = 3
    appearance = np.zeros((n, 8))
    appearance[:, 6], appearance[:, 7] = times, learned
    points = ControlPoints(np.zeros((n, 3)), np.zeros((n, 3), np.int64), np.arange(n), np.array([0, n]))
    found = Candidates(np.full((n, 1), distance), np.full((n, 1), contrast))
    own = point_variances(points, found, appearance, WEAK_STEP, kernel_values(WEIGHTS))
    lines = SearchLines(np.zeros((n, 4)), np.zeros((n, 6)), np.full(n, side))
    measured = EdgeMeasurements(points, lines, found, np.full(n, trusted), own)
    return own, offset_variances(measured, kernel_values(WEIGHTS))


@pytest.mark.parametrize("learned", [0.0, 0.01, 0.4])
def test_a_control_point_errs_by_what_was_learned_of_it(learned):
    own, shared = of_one_edge(learned)
    assert own == pytest.approx([OWN_VARIANCE + learned] * 3)
    assert shared == pytest.approx([SILHOUETTE_VARIANCE])


def test_one_that_is_not_known_yet_errs_by_its_contrast():
    for contrast in (WEAK_STEP / 2, WEAK_STEP, 4 * WEAK_STEP):
        own, _ = of_one_edge(9.0, times=0.0, contrast=contrast)
        assert own == pytest.approx([OWN_VARIANCE + min(1.0, WEAK_STEP / contrast) ** 2] * 3)


def test_the_offset_of_an_edge_is_wider_on_creases_and_where_it_weighs_less():
    assert of_one_edge(0.0, side=0)[1] == pytest.approx([CREASE_VARIANCE])
    assert of_one_edge(0.0, trusted=0.5)[1] == pytest.approx([2 * SILHOUETTE_VARIANCE])
    assert of_one_edge(0.0, trusted=0.001)[1] == pytest.approx([50 * SILHOUETTE_VARIANCE])
    assert of_one_edge(0.0, distance=np.inf)[1] == pytest.approx([SILHOUETTE_VARIANCE])
