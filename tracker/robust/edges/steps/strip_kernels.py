"""Compiled fit of a step that stands alone to all pixels of a strip along its edge, by their mean scan lines.

An edge crosses the scan lines at any place between two pixels. Those that it crosses at about the same place are
averaged before the fit, so that a long strip takes little more time than a few lines: the slanted edge of ISO 12233.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.optics_kernels import BLOWN_OUT
from uavbench.tracker.robust.edges.steps.step_kernels import NO_STEP, Alone, Step, fit_alone
from uavbench.tracker.robust.edges.steps.sum_kernels import (
    ACROSS,
    REACH_PX,
    Strip,
    blur_of,
    crossed_at,
    first_pixel,
    scan_across,
    step_at,
)
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

PLACES = 8
"""Places between two pixels: scan lines that are averaged cross the edge within an eighth of a pixel."""


class MeanLines(NamedTuple):
    """Scan lines across an edge, summed up by the place at which they cross it; made once for many fits.

    lines (PLACES,): their number; first_px and first_px2 (PLACES,): sums of the distances of their first pixels from
    the edge, and of the squares. light (PLACES, ACROSS): sum of their light; step, slope (PLACES, ACROSS): H and H' of
    their mean. products (4, 4): as of `Sums`.
    """

    lines: Array
    first_px: Array
    first_px2: Array
    light: Array
    step: Array
    slope: Array
    products: Array


@compiled("", inner=True)
def room_for_lines() -> MeanLines:
    """Arrays for a fit."""
    across = PLACES, ACROSS
    return MeanLines(
        np.empty(PLACES),
        np.empty(PLACES),
        np.empty(PLACES),
        np.empty(across),
        np.empty(across),
        np.empty(across),
        np.empty((4, 4)),
    )


@inlined(allocates=False)
def sum_lines(image: Image, edge: Array, start: float, strip: Strip, colour: Array, mean: MeanLines) -> float:
    """Sum up all scan lines of a strip along an edge (4,), moved by `start` px, and return the sum of squared light.

    Negative where a pixel is blown out, whose light is not known.
    """
    channels, light_of, square, brightest = image.shape[2], strip.optics.light, 0.0, 0
    scan = scan_across(image, edge, start)
    for array in (mean.lines, mean.first_px, mean.first_px2):
        array[:] = 0.0
    mean.light[:] = 0.0
    middle = int(scan.y0 + 0.5)
    for y in range(max(0, middle - strip.along), min(scan.height, middle + strip.along + 1)):
        crossed = crossed_at(scan, y)
        low = first_pixel(scan, crossed)
        if low < 0:
            continue
        away = low - crossed
        at = min(PLACES - 1, max(0, int((away + REACH_PX + 0.5) * PLACES)))
        mean.lines[at] += 1.0
        mean.first_px[at] += away * scan.nx
        mean.first_px2[at] += away * away * scan.nx * scan.nx
        for x in range(ACROSS):
            column, row = (low + x, y) if scan.by_rows else (y, low + x)
            light = 0.0
            for c in range(channels):
                code = image[row, column, c]
                brightest = max(brightest, int(code))
                light += colour[c] * light_of[0, code]
            mean.light[at, x] += light
            square += light * light
    return -1.0 if brightest >= BLOWN_OUT else square


@inlined(allocates=False)
def sum_products(edge: Array, strip: Strip, mean: MeanLines) -> float:
    """Sum up the products of the step and the light of lines that are summed up, each as of the mean of its place.

    Returns by how much the squares of the slope times the distances of the lines of a place from their mean sum up: the
    light of a step of height 1 differs by as much among them.
    """
    nu, nv, products, apart = edge[NORMAL_U], edge[NORMAL_V], mean.products, 0.0
    each_px, blur = nu if abs(nu) >= abs(nv) else nv, blur_of(nu, nv, strip.optics.blur_px)
    products[:] = 0.0
    for at in range(PLACES):
        n = mean.lines[at]
        if n == 0.0:
            continue
        first_px = mean.first_px[at] / n
        apart_px2 = max(0.0, mean.first_px2[at] - n * first_px * first_px)
        for x in range(ACROSS):
            blurred = step_at(first_px + x * each_px, blur)
            H, S, L = blurred.step, blurred.slope, mean.light[at, x]
            mean.step[at, x], mean.slope[at, x] = H, S
            products[0, 0] += n * H * H
            products[1, 0] += n * S * H
            products[1, 1] += n * S * S
            products[2, 0] += L * H
            products[2, 1] += L * S
            products[3, 0] += n * H
            products[3, 1] += n * S
            products[3, 2] += L
            apart += apart_px2 * S * S
        products[3, 3] += n * ACROSS
    return apart


@inlined(allocates=False)
def fit_strip(
    image: Image, edge: Array, start: float, strip: Strip, colour: Array, mean: MeanLines, misfit: Array
) -> Step:
    """As `fit_step` of an edge (4,) that stands alone, by all scan lines of the strip; writes its misfit (ACROSS,).

    NO_STEP also where a pixel is blown out.
    """
    square = sum_lines(image, edge, start, strip, colour, mean)
    if square < 0.0:
        return NO_STEP
    apart, products = sum_products(edge, strip, mean), mean.products
    products[2, 2], pixels = square, products[3, 3]
    if pixels < 3 * ACROSS:
        return NO_STEP
    fit = fit_alone(products, strip.optics.light[0, 1])
    if not fit.height > 0.0:
        return NO_STEP
    write_misfit_of_lines(fit, mean, misfit)
    of_places = fit.height * fit.height * apart / (pixels - 3.0)  # no noise
    return Step(start + fit.shift, max(0.0, fit.variance_px2 - fit.variance * of_places))


@inlined(allocates=False)
def write_misfit_of_lines(fit: Alone, mean: MeanLines, misfit: Array) -> None:
    """As `write_misfit`, of mean lines: misfit (ACROSS,), px."""
    products, height, shift = mean.products, fit.height, fit.shift
    level = (products[3, 2] - height * (products[3, 0] - shift * products[3, 1])) / products[3, 3]
    per_light = math.sqrt(fit.variance * ACROSS / (products[3, 3] * (ACROSS - 3)))
    for x in range(ACROSS):
        total = 0.0
        for at in range(PLACES):
            if mean.lines[at] > 0.0:
                model = level + height * (mean.step[at, x] - shift * mean.slope[at, x])
                total += mean.light[at, x] - mean.lines[at] * model
        misfit[x] = per_light * total
