"""All pixels of a strip along an edge that stands alone tell its place: as exactly as they can, by their mean lines."""

import numpy as np
import pytest

from tests.tracker.test_step_kernels import BLUR_PX, BRIGHT, SRGB, direction, edge, strip
from uavbench.tracker.robust.edges.steps.optics_kernels import ALIGNED, Optics
from uavbench.tracker.robust.edges.steps.step_kernels import fit_step
from uavbench.tracker.robust.edges.steps.strip_kernels import fit_strip, room_for_lines
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, Strip, room_for
from uavbench.trajectories.kernels.compiled import unchecked

ALONG_PX = 12


def by_strip(image, line, start, along_px=ALONG_PX):
    """Step by all lines, and the sum of its squared misfits."""
    misfit, optics = np.zeros(ACROSS), Optics(SRGB[None], BLUR_PX, ALIGNED)
    found = unchecked(fit_strip)(
        image, line, start, Strip(along_px, 0, optics), direction()[1], room_for_lines(), misfit
    )
    return found, (misfit**2).sum()


def by_lines(image, line, start, lines):
    """Step by so many lines to either side, each by itself."""
    seen = Strip(ALONG_PX, lines, Optics(SRGB[None], BLUR_PX, ALIGNED))
    return fit_step(image, line[None], start, seen, direction()[1], room_for(6, 0, lines))


@pytest.mark.parametrize("angle", [0, 1, 7, 20, 45, 70, 90, 93, 135, 200, 310])
@pytest.mark.parametrize("off", [-0.1, 0.0, 0.06])
def test_a_step_is_found_to_a_hundredth_of_a_pixel(angle, off):
    image, line = edge(0.3, angle)
    assert by_strip(image, line, 0.3 + off)[0].distance == pytest.approx(0.3, abs=0.012)


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("angle", [0, 4, 30, 45, 88, 170])
def test_it_is_that_of_all_lines_each_by_itself(angle, noise):
    """With its variance, of which lines that are averaged, an eighth of a pixel from each other, are no part."""
    image, line = edge(-0.2, angle, noise, np.random.default_rng(0))
    mean, each = by_strip(image, line, -0.15)[0], by_lines(image, line, -0.15, ALONG_PX)
    assert mean.distance == pytest.approx(each.distance, abs=0.001)
    assert mean.variance_px2 == pytest.approx(each.variance_px2, rel=0.1, abs=0.001**2)


def test_its_variance_is_that_of_its_error_and_a_third_of_that_by_nine_lines():
    rng, fits, few = np.random.default_rng(0), [], []
    for _ in range(200):
        image, line = edge(0.1, rng.uniform(0, 360), 3.0, rng)
        fits.append(by_strip(image, line, 0.1)[0])
        few.append(by_lines(image, line, 0.1, 4))
    found, variance = np.transpose(fits)
    assert 0.6 < np.mean((found - 0.1) ** 2 / variance) < 1.6
    assert np.var(found) < 0.6 * np.var(np.transpose(few)[0])


@pytest.mark.parametrize("angle", [0, 30, 90, 200])
def test_what_noise_misfits_is_its_variance(angle):
    rng = np.random.default_rng(0)
    fits = [by_strip(*edge(0.2, angle, 12.0, rng), 0.15) for _ in range(100)]
    found = [(step.variance_px2, misfit) for step, misfit in fits if np.isfinite(step.distance)]
    variance, misfit = np.mean(found, axis=0)
    assert len(found) > 90
    assert misfit == pytest.approx(variance, rel=0.2)


@pytest.mark.parametrize("angle", [0, 20, 110])
@pytest.mark.parametrize(("gap", "middle"), [(2.0, 0.9), (2.5, 0.7), (3.0, 0.7)])
def test_what_a_line_beside_it_misfits_is_as_large_as_the_error_it_makes(gap, middle, angle):
    image, lines = strip(gap, 0.1, angle, middle)
    found, misfit = by_strip(image, lines[0], by_strip(image, lines[0], 0.1)[0].distance)
    error = abs(found.distance - 0.1)
    assert error > 1.4 * found.variance_px2**0.5
    assert 0.5 * error < misfit**0.5 < 2.0 * error


def test_light_that_is_blown_out_and_a_strip_outside_of_the_image_tell_nothing():
    assert by_strip(*edge(0.0, 20), 0.0)[0].distance < np.inf
    assert by_strip(*edge(0.0, 20, bright=3 * BRIGHT), 0.0)[0].distance == np.inf
    image, line = edge(0.0, 90)
    line[1] = 1.0
    assert by_strip(image, line, 0.0)[0].distance == np.inf


def test_a_step_of_less_than_a_code_or_the_other_way_is_none():
    image, line = edge(0.0, 20)
    even = np.full_like(image, 100)
    assert by_strip(even, line, 0.0)[0].distance == np.inf
    turned = line.copy()
    turned[2:] *= -1.0
    assert by_strip(image, turned, 0.0)[0].distance == np.inf
