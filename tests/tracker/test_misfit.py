"""What a located edge misfits of the light beside it: noise averages out along the edge, a line beside it does not."""

import numpy as np
import pytest

from tests.tracker.test_step_kernels import direction, edge, fit, strip
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, room_for
from uavbench.tracker.robust.edges.subpixel_kernels import add_variances

POINTS = 12
NOISE_PX2 = 1e-4


def misfit_of(image, line, start):
    """Distance of a step, its variance by noise of each pixel and by a misfit that is the same on all scan lines."""
    room = room_for(6, 0, 2)
    found = fit(image, line, start, direction()[1], room=room)
    return found.distance, found.variance_px2, (room.misfit**2).sum()


@pytest.mark.parametrize("angle", [0, 30, 90, 200])
def test_that_of_noise_is_its_variance(angle):
    rng = np.random.default_rng(0)
    draws = np.array([misfit_of(*edge(0.2, angle, 6.0, rng), 0.1) for _ in range(100)])
    found, variance, alike = draws[np.isfinite(draws[:, 0])].T
    assert len(found) > 90
    assert alike.mean() == pytest.approx(variance.mean(), rel=0.2)


@pytest.mark.parametrize("angle", [0, 20, 90, 110])
@pytest.mark.parametrize(("gap", "middle"), [(1.5, 0.9), (2.0, 0.9), (2.0, 1.3), (2.5, 0.7), (3.0, 0.7)])
def test_that_of_a_line_beside_the_edge_is_as_large_as_the_error_it_makes(gap, middle, angle):
    image, lines = strip(gap, 0.1, angle, middle)
    near = misfit_of(image, lines[0], 0.1)[0]
    found, variance, alike = misfit_of(image, lines[0], near)
    error = abs(found - 0.1)
    assert error > 1.4 * np.sqrt(variance), "noise does not explain it"
    assert 0.5 * error < np.sqrt(alike) < 2.0 * error


def variances(misfit):
    """Variances that are added to those of an edge's points, in those that noise of each pixel explains."""
    out = np.zeros(len(misfit))
    own = np.full(len(misfit), NOISE_PX2)
    add_variances(out, own, misfit, np.ones(len(misfit), np.int64), np.array([0, len(misfit)]))
    return out / NOISE_PX2


def drawn(rng, correlation, scale):
    """Misfits (POINTS, ACROSS) of points whose neighbours have this correlation, in deviations of the noise."""
    out = rng.normal(size=(POINTS, ACROSS))
    for p in range(1, POINTS):
        out[p] = correlation * out[p - 1] + np.sqrt(1 - correlation**2) * out[p]
    return scale * np.sqrt(NOISE_PX2 / ACROSS) * out


def test_noise_leaves_the_variance_nearly_as_it_is():
    """By chance half of the edges have squares above those of noise, and those below count as no fewer."""
    rng = np.random.default_rng(0)
    drawn_ones = np.array([variances(drawn(rng, 0.0, 1.0)).mean() for _ in range(200)])
    assert 0.4 < (drawn_ones == 1.0).mean() < 0.6
    assert 1.0 < drawn_ones.mean() < 1.25
    assert (variances(drawn(rng, 0.0, 0.1)) == 1.0).all(), "less than the noise is no less"


@pytest.mark.parametrize(("correlation", "alike"), [(0.0, 1.0), (0.6, 4.0), (1.0, POINTS)])
def test_the_more_it_is_alike_from_point_to_point_the_less_it_averages_out(correlation, alike):
    rng, scale = np.random.default_rng(0), 5.0
    mean = np.median([variances(drawn(rng, correlation, scale)).mean() for _ in range(400)])
    assert mean == pytest.approx(1.0 + alike * (scale**2 - 1), rel=0.35)


def test_the_mean_of_points_that_misfit_alike_is_as_uncertain_as_one_of_them():
    misfit = drawn(np.random.default_rng(0), 1.0, 5.0)
    of_mean = variances(misfit).mean() / POINTS
    assert of_mean == pytest.approx((misfit[0] ** 2).sum() / NOISE_PX2, rel=0.2)
    assert variances(misfit[:1])[0] == pytest.approx((misfit[0] ** 2).sum() / NOISE_PX2)


def test_points_that_are_not_located_say_nothing_and_keep_their_variance():
    misfit = drawn(np.random.default_rng(0), 1.0, 5.0)
    misfit[3:5] = 1e3
    out, own, steps = np.full(POINTS, 0.5), np.full(POINTS, NOISE_PX2), np.ones(POINTS, np.int64)
    steps[3:5] = 0
    add_variances(out, own, misfit, steps, np.array([0, POINTS]))
    expected = 0.5 + NOISE_PX2 * variances(np.delete(misfit, [3, 4], axis=0))
    assert (out[3:5] == 0.5).all()
    np.testing.assert_allclose(np.delete(out, [3, 4]), expected)
