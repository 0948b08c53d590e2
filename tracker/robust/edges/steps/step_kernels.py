"""Compiled fit of blurred steps of linear light to the pixels around a control point.

Near an edge the light is a + b H(s), with s the distance across it and H a step blurred by pixel and lens. Within a few
pixels lie others: the borders of a reveal, of a flange, of lattice members. The light is a + sum_k b_k H(s_k - d):
least squares in the level a, the heights b_k and one shift d, whose residual gives the variance of d. Where an error of
the pose moves the edges by d_k of their own, d is their mean by the shares of the steps in it.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, Strip, Sums, sums_of_steps
from uavbench.trajectories.kernels.compiled import inlined
from uavbench.trajectories.pose import Array

CLEAR_WIDTHS = 3.0
"""Reach of the blur of a neighbouring edge, in its standard deviations."""
MAX_SHIFT_PX = 0.5
"""Largest shift: the linearized fit is valid within one standard deviation of the usual blur."""
MOST_STEPS = 6
"""Most steps that are fitted together: limits the time."""
TOGETHER_WIDTHS = 2.0
"""Distance across, in standard deviations of the blur, below which the heights of two steps are hardly told apart, and
their sum must be a step."""
HEIGHT_INFORMATION = 1e-4
"""Prior information on a height: the square of a pixel's noise, 0.01, over that of a height, 1. It decides where two
edges are one in the image."""
LEAST_SEEN = 1 / 3
"""Part of the pixels about a point that must not be blown out: those of one side, and of the step."""
ITERATIONS = 3
"""Of Gauss-Newton: the heights, then the shift with them, then both."""


class Step(NamedTuple):
    """Distance of a step in px along a normal, and its variance in px^2."""

    distance: float
    variance_px2: float


class Alone(NamedTuple):
    """A step that stands alone: its height, 0 without one, and its shift in px with the variance_px2.

    variance: that for light of unit variance; moved_px: what the last iteration moved it by.
    """

    height: float
    shift: float
    variance: float
    variance_px2: float
    moved_px: float


NO_STEP = Step(np.inf, np.inf)
NOTHING = Alone(0.0, 0.0, 0.0, 0.0, 0.0)


@inlined(allocates=False)
def solve(A: Array, x: Array) -> float:
    """Solve A y = x (n,) in place by A = L D L^T, and return x . y, NaN where A is not positive.

    x becomes y, the lower half of A (n, n) becomes L D and its diagonal D^-1. A may have more rows and columns.
    """
    n, product = len(x), 0.0
    for i in range(n):
        for j in range(i + 1):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k] * A[k, k]
        if not A[i, i] > 0.0:
            return math.nan
        A[i, i] = 1.0 / A[i, i]
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        product += x[i] * x[i] * A[i, i]
        x[i] *= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[i, i] * A[k, i] * x[k]
    return product


@inlined(allocates=False)
def fit_step(image: Image, edges: Array, start: float, strip: Strip, colour: Array, sums: Sums) -> Step:
    """The step of a control point's edge around distance `start`, fitted together with those beside it.

    Arguments as of `sums_of_steps`. NO_STEP without a step in the direction `colour`, or too few pixels; otherwise the
    derivatives of the distance for the response, where there are several steps for their own distances, and the misfit
    are in `sums`.
    """
    steps, n = len(edges), sums_of_steps(image, edges, start, strip, colour, True, sums)
    products, last, rows = sums.products, 2 * steps + 1, len(sums.by_response)
    seen = products[last, last]
    if n < 3 * ACROSS or not seen > LEAST_SEEN * n:
        return NO_STEP
    if steps == 1 and rows == 0:
        alone = fit_alone(sums.products, strip.optics.light[0, 1])
        if not alone.height > 0.0:
            return NO_STEP
        sums.height[0] = alone.height
        write_misfit(1, n, Step(alone.shift, alone.variance), sums)
        return Step(start + alone.shift, alone.variance_px2 + left_px2(seen, n, alone.moved_px))
    for i in range(last + 1, last + 1 + rows):  # the level is eliminated
        for j in range(last):
            products[i, j] -= products[i, last] * products[last, j] / seen
    for i in range(last):
        for j in range(i + 1):
            products[i, j] -= products[last, i] * products[last, j] / seen
            products[j, i] = products[i, j]
    light, A, x, height = 2 * steps, sums.A, sums.x[: steps + 1], sums.height
    for i in range(steps):
        height[i] = 0.0
    shift, explained = 0.0, 0.0
    for iteration in range(ITERATIONS):
        A[steps, steps] = x[steps] = 0.0
        for i in range(steps):
            at, slope = 2 * i, 2 * i + 1
            x[i] = products[at, light] - shift * products[slope, light]
            x[steps] -= height[i] * products[slope, light]
            A[steps, i] = 0.0
            for j in range(steps):
                cross = products[at, 2 * j + 1] - shift * products[slope, 2 * j + 1]
                A[steps, i] -= height[j] * cross
                A[steps, steps] += height[i] * height[j] * products[slope, 2 * j + 1]
                A[i, j] = products[at, 2 * j] - shift * products[slope, 2 * j] - shift * cross
            A[i, i] += HEIGHT_INFORMATION
        if iteration == 0:
            A[steps, steps] = 1.0  # without heights the light says nothing of the shift, which stays 0
        explained = solve(A, x)
        for i in range(steps):
            height[i] = x[i]
        shift += x[steps]
        if not (explained >= 0.0 and abs(shift) < 2 * MAX_SHIFT_PX):  # singular, or it diverges
            return NO_STEP
    whole = height[0]
    for i in range(1, steps):
        across = (edges[i, U] - edges[0, U]) * edges[0, NORMAL_U] + (edges[i, V] - edges[0, V]) * edges[0, NORMAL_V]
        if abs(across) < TOGETHER_WIDTHS * strip.optics.blur_px:
            whole += height[i]
    if not whole > strip.optics.light[0, 1]:  # less than one code
        return NO_STEP
    noise = max(0.0, products[light, light] - explained) / (seen - steps - 2)
    for r in range(rows):
        sums.by_response[r] = -moved_by(last + 1 + r, steps, shift, sums) * A[steps, steps]
    for own in range(steps if steps > 1 else 0):
        sums.shares[own] = -height[own] * moved_by(2 * own + 1, steps, shift, sums) * A[steps, steps]
    write_misfit(steps, n, Step(shift, A[steps, steps]), sums)
    return Step(start + shift, noise * A[steps, steps] + left_px2(seen, n, x[steps]))


@inlined(allocates=False)
def write_misfit(steps: int, n: int, shift: Step, sums: Sums) -> None:
    """Write what a fit leaves of the light of n pixels, summed up along the edge, into the misfit in `sums`.

    shift: of the fit, with its variance for light of unit variance. As deviations of the distance, px, one for each
    column of the pixels, whose squares sum up to its variance if the misfit is the same on all scan lines, as that of a
    line beside the edge is. The level, the heights and the shift take degrees of freedom; where they take all, it is 0.
    """
    products, height, misfit, last, free = sums.products, sums.height, sums.misfit, 2 * steps + 1, ACROSS - steps - 2
    level, light_block, light_column = products[last, 2 * steps], steps // 2, 2 * (steps % 2)
    for i in range(steps):
        level -= height[i] * (products[last, 2 * i] - shift.distance * products[last, 2 * i + 1])
    level /= products[last, last]
    per_light = math.sqrt(shift.variance_px2 * ACROSS / (n * free)) if free > 0 else 0.0
    for x in range(ACROSS):
        total = 0.0
        for q in range(x, n, ACROSS):
            total += sums.terms[light_block, q, light_column] - level * sums.terms[light_block, q, light_column + 1]
            for i in range(steps):
                block, at = i // 2, 2 * (i % 2)
                total -= height[i] * (sums.terms[block, q, at] - shift.distance * sums.terms[block, q, at + 1])
        misfit[x] = per_light * total


@inlined(allocates=False)
def moved_by(row: int, steps: int, shift: float, sums: Sums) -> float:
    """What a unit of the term in a row of the products adds to the light, as the shift sees it, the heights eliminated.

    At the minimum, where the shift is linear in the light; A in `sums` is L D, see `solve`.
    """
    products, A, x, height, moved = sums.products, sums.A, sums.x, sums.height, 0.0
    for i in range(steps):
        moved -= height[i] * products[row, 2 * i + 1]
        x[i] = products[row, 2 * i] - shift * products[row, 2 * i + 1]
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] *= A[i, i]
    for i in range(steps):
        moved -= A[steps, i] * x[i]
    return moved


@inlined(allocates=False)
def left_px2(seen: float, n: int, moved_px: float) -> float:
    """What is left of the last iteration's step, squared, where a side is blown out: its level is told by little."""
    return moved_px * moved_px if seen < n else 0.0


@inlined(allocates=False)
def fit_alone(products: Array, least: float) -> Alone:
    """As `fit_step` of one step, from the products (4, 4) of its terms, whose height must be more than `least`.

    The same operations in the same order, number by number: most edges stand alone.
    """
    seen = products[3, 3]
    HH, SH, SS = products[0, 0], products[1, 0], products[1, 1]
    LH, LS, LL = products[2, 0], products[2, 1], products[2, 2]
    of_H, of_S, of_L = products[3, 0], products[3, 1], products[3, 2]
    HH, SH, SS = HH - of_H * of_H / seen, SH - of_S * of_H / seen, SS - of_S * of_S / seen  # the level is eliminated
    LH, LS, LL = LH - of_L * of_H / seen, LS - of_L * of_S / seen, LL - of_L * of_L / seen
    height, shift, explained, variance = 0.0, 0.0, 0.0, 0.0
    for iteration in range(ITERATIONS):
        cross = SH - shift * SS
        A, B = HH - shift * SH - shift * cross + HEIGHT_INFORMATION, 0.0 - height * cross
        C = 1.0 if iteration == 0 else height * height * SS
        x, y = LH - shift * LS, 0.0 - height * LS
        if not A > 0.0:
            return NOTHING
        A = 1.0 / A
        C -= B * B * A
        if not C > 0.0:
            return NOTHING
        variance = 1.0 / C
        explained = x * x * A
        x *= A
        y -= B * x
        explained += y * y * variance
        y *= variance
        height = x - A * B * y
        shift += y
        if not (explained >= 0.0 and abs(shift) < 2 * MAX_SHIFT_PX):
            return NOTHING
    if not height > least:
        return NOTHING
    return Alone(height, shift, variance, max(0.0, LL - explained) / (seen - 3) * variance, y)
