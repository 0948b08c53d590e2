"""The mean of a few values and its uncertainty by Student's t, against SciPy's own."""

import numpy as np
import pytest
from scipy.stats import t, ttest_1samp

from uavbench.reports.statistics.student import StudentMean, widening

VALUES = np.array([0.05, 0.08, 0.12, 0.2, 0.25])


@pytest.mark.parametrize("limit", [-0.1, 0.0, 0.14, 0.3])
@pytest.mark.parametrize("values", [VALUES, VALUES[:2], -VALUES])
def test_p_and_bounds_are_those_of_the_books(values: np.ndarray, limit: float) -> None:
    found = StudentMean.of(values)
    expected = ttest_1samp(values, limit, alternative="greater")
    assert found.p_above(limit) == pytest.approx(expected.pvalue, rel=1e-6)
    assert found.p_two_sided == pytest.approx(ttest_1samp(values, 0.0).pvalue, rel=1e-6)
    low, high = t.interval(0.9, len(values) - 1, values.mean(), values.std(ddof=1) / np.sqrt(len(values)))
    assert (found.bound(0.05), found.bound(0.95)) == pytest.approx((low, high), rel=1e-9)


def test_equal_values_are_above_a_limit_or_not() -> None:
    found = StudentMean.of(np.full(4, 0.5))
    assert (found.p_above(0.4), found.p_above(0.6), found.p_above(0.5)) == (0.0, 1.0, 1.0)
    assert found.p_above(0.5 - 1e-15) == 1.0, "round-off is no change"
    assert (found.bound(0.05), found.bound(0.95)) == (0.5, 0.5)
    assert (found.p_two_sided, StudentMean.of(np.zeros(4)).p_two_sided) == (0.0, 1.0)


def test_one_value_has_no_uncertainty_to_be_told() -> None:
    found = StudentMean.of(np.array([0.5]))
    assert (found.mean, found.p_two_sided) == (0.5, 1.0)
    assert np.isnan([found.bound(0.05), found.bound(0.95), found.p_above(0.0)]).all()


def test_an_interval_of_few_values_is_wider_than_the_normal_one() -> None:
    """Of tables of Student's t: 12.706, 4.303 and 2.571 at 97.5 % with 1, 2 and 5 degrees of freedom."""
    found = [widening(n, 0.025) * 1.959964 for n in (2, 3, 6)]
    assert found == pytest.approx([12.706, 4.303, 2.571], abs=1e-3)
    assert widening(10**6, 0.025) == pytest.approx(1.0, abs=1e-5)
