"""Compiled fit of blurred steps of linear light to the pixels around a control point.

Near an edge the light is a + b H(s), with s the distance across it and H a step blurred by pixel and lens. Within a few
pixels lie others: the borders of a reveal, of a flange, of lattice members. All of them are moved by the same error of
the pose, so that the light is a + sum_k b_k H(s_k - d): least squares in the level a, the heights b_k and the one shift
d, whose residual gives the variance of d.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import (
    NEGATIVE_COLOUR,
    NORMAL_U,
    NORMAL_V,
    POSITIVE_COLOUR,
    TIMES_SEEN,
    U,
    V,
)
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

PIXEL_PX = 1 / math.sqrt(12)
"""Standard deviation of the area of a pixel, in any direction: the least blur."""
FIRST_BLUR_PX = 0.5
"""Blur of a frame before any was measured: that of a pixel, and 0.4 px of a sharp lens."""
CLEAR_WIDTHS = 3.0
"""Reach of the blur of a neighbouring edge, in its standard deviations."""
MAX_SHIFT_PX = 0.5
"""Largest shift: the linearized fit is valid within one standard deviation of the usual blur."""
REACH_PX = 3
"""Pixels to either side of the edge on a scan line: fewer do not determine a step and two levels, more add little."""
ACROSS = 2 * REACH_PX + 1
"""Pixels of a scan line."""
WIDTHS, STEPS_PER_WIDTH = 5, 64
MIDDLE = WIDTHS * STEPS_PER_WIDTH
AT = np.arange(-MIDDLE, MIDDLE + 1) / STEPS_PER_WIDTH
STEP = np.array([0.5 * (1 + math.erf(s / math.sqrt(2))) for s in AT])
SLOPE = np.exp(-0.5 * np.square(AT)) / math.sqrt(2 * math.pi)
"""H and H' at AT, in standard deviations of the blur."""
MOST_STEPS = 6
"""Most steps that are fitted together: limits the time."""
TOGETHER_WIDTHS = 2.0
"""Distance across, in standard deviations of the blur, below which the heights of two steps are hardly told apart, and
their sum must be a step."""
HEIGHT_INFORMATION = 1e-4
"""Prior information on a height: the square of a pixel's noise, 0.01, over that of a height, 1. It decides where two
edges are one in the image."""
TILE = 4
"""Rows and columns of the products that are summed up together, which the registers of a processor hold."""
ITERATIONS = 3
"""Of Gauss-Newton: the heights, then the shift with them, then both."""


class Step(NamedTuple):
    """Distance of a step in px along a normal, and its variance in px^2."""

    distance: float
    variance_px2: float


class Optics(NamedTuple):
    """How light becomes codes: light (1 + r, 256) of each code, then its derivatives for r numbers of the response, and
    the standard deviation blur_px of the blur.
    """

    light: Array
    blur_px: float


class Strip(NamedTuple):
    """Pixels about a control point: about `beside` scan lines to either side, spread over `along` px; their optics."""

    along: int
    beside: int
    optics: Optics


class Sums(NamedTuple):
    """Arrays that a fit of up to k steps writes, made once for many fits.

    terms (m, p, TILE): in so many blocks of columns, at each of p pixels, H and H' of each step, the light, 1, and the
    light's derivatives. products (TILE m, TILE m): its lower half is their sums over all pixels. A (k + 1, k + 1),
    x (k + 1,): normal equations of the heights and the shift. height (k,). by_response (r,): derivatives of the shift.
    """

    terms: Array
    products: Array
    A: Array
    x: Array
    height: Array
    by_response: Array


NO_STEP = Step(np.inf, np.inf)
OPTICS = named_tuple(Optics, "f2! f0")


@compiled("i0 i0 i0", inner=True)
def room_for(steps: int, derivatives: int, beside: int) -> Sums:
    """Arrays for fits of up to so many steps, with so many derivatives of the light, on strips of so many lines."""
    blocks, unknowns = (2 * steps + 2 + derivatives + TILE - 1) // TILE, steps + 1
    return Sums(
        np.zeros((blocks, (2 * beside + 1) * ACROSS, TILE)),
        np.empty((TILE * blocks, TILE * blocks)),
        np.empty((unknowns, unknowns)),
        np.empty(unknowns),
        np.empty(steps),
        np.empty(derivatives),
    )


@inlined
def learned_light(row: Array, channels: int, light: Array, colour: Array) -> float:
    """Learned intensity step of an edge, 0 if nothing is learned; its direction in colour space goes into `colour`."""
    colour[:] = 0.0
    if not row[TIMES_SEEN] > 0.0:
        return 0.0
    square = 0.0
    for c in range(channels):
        high, low = row[POSITIVE_COLOUR + c], row[NEGATIVE_COLOUR + c]
        colour[c] = light[0, min(255, int(high + 0.5))] - light[0, min(255, int(low + 0.5))]
        square += colour[c] * colour[c]
    step = math.sqrt(square)
    if step > 0.0:
        for c in range(channels):
            colour[c] /= step
    return step


@inlined
def sums_of_steps(image: Image, edges: Array, start: float, strip: Strip, colour: Array, sums: Sums) -> int:
    """Number of pixels around a control point whose steps and light are summed up.

    edges (k, 4): pixel and normal of the point's edge and of those beside it, all moved by `start` px. The pixels are
    on scan lines, rows or columns, that cross the edge more steeply: about `beside` to either side of the point, spread
    over `along` px. The first 2 k + 2 + r rows of the products in `sums` become those of these pixels.
    """
    h, w, channels = image.shape
    along, beside, widths_per_px = strip.along, strip.beside, 1.0 / strip.optics.blur_px
    light_of = strip.optics.light
    nu, nv = edges[0, NORMAL_U], edges[0, NORMAL_V]
    u, v = edges[0, U] + start * nu, edges[0, V] + start * nv
    by_rows = abs(nu) >= abs(nv)
    if by_rows:
        x0, y0, nx, ny, width, height = u, v, nu, nv, w, h
    else:
        x0, y0, nx, ny, width, height = v, u, nv, nu, h, w
    steps, pixels, rows_per_px = len(edges), 0, STEPS_PER_WIDTH * widths_per_px
    terms, light_block, light_column = sums.terms, steps // 2, 2 * (steps % 2)
    middle, every = int(y0 + 0.5), max(1, (along + beside - 1) // beside)
    for k in range(-(along // every), along // every + 1):
        y = middle + k * every
        low = int(x0 - (y - y0) * ny / nx + 0.5) - REACH_PX
        if y < 0 or y >= height or low < 0 or low + 2 * REACH_PX >= width:
            continue
        column, row = (low, y) if by_rows else (y, low)
        for i in range(steps):
            mu, mv = edges[i, NORMAL_U], edges[i, NORMAL_V]
            away = (column - edges[i, U]) * mu + (row - edges[i, V]) * mv - start
            first, each = away * rows_per_px + MIDDLE, (mu if by_rows else mv) * rows_per_px
            block, odd = i // 2, i % 2 == 1
            for x in range(ACROSS):
                at = np.uint32(min(max(first + x * each, 0.0), 2.0 * MIDDLE) + 0.5)
                if odd:
                    terms[block, pixels + x, 2], terms[block, pixels + x, 3] = STEP[at], SLOPE[at] * widths_per_px
                else:
                    terms[block, pixels + x, 0], terms[block, pixels + x, 1] = STEP[at], SLOPE[at] * widths_per_px
        for x in range(ACROSS):
            column, row = (low + x, y) if by_rows else (y, low + x)
            light = 0.0
            for c in range(channels):
                light += colour[c] * light_of[0, image[row, column, c]]
            terms[light_block, pixels + x, light_column] = light
            terms[light_block, pixels + x, light_column + 1] = 1.0
        for r in range(len(light_of) - 1):
            at_block, at_column = divmod(2 * steps + 2 + r, TILE)
            for x in range(ACROSS):
                column, row = (low + x, y) if by_rows else (y, low + x)
                light = 0.0
                for c in range(channels):
                    light += colour[c] * light_of[1 + r, image[row, column, c]]
                terms[at_block, pixels + x, at_column] = light
        pixels += ACROSS
    for i in range((2 * steps + 2 + len(light_of) - 1 + TILE - 1) // TILE):
        for j in range(i):
            sum_tile(terms, i, j, pixels, sums.products)
        sum_half_tile(terms, i, pixels, sums.products)
    return pixels


@inlined
def sum_tile(terms: Array, i: int, j: int, pixels: int, products: Array) -> None:
    """The products of all columns of blocks i and j of the terms, summed up in the order of so many pixels.

    One number at a time: a processor holds all of them in its registers, and the order of each sum is as written.
    """
    p00 = p01 = p02 = p03 = p10 = p11 = p12 = p13 = 0.0
    p20 = p21 = p22 = p23 = p30 = p31 = p32 = p33 = 0.0
    for x in range(pixels):
        a0, a1, a2, a3 = terms[i, x, 0], terms[i, x, 1], terms[i, x, 2], terms[i, x, 3]
        b0, b1, b2, b3 = terms[j, x, 0], terms[j, x, 1], terms[j, x, 2], terms[j, x, 3]
        p00, p01, p02, p03 = p00 + a0 * b0, p01 + a0 * b1, p02 + a0 * b2, p03 + a0 * b3
        p10, p11, p12, p13 = p10 + a1 * b0, p11 + a1 * b1, p12 + a1 * b2, p13 + a1 * b3
        p20, p21, p22, p23 = p20 + a2 * b0, p21 + a2 * b1, p22 + a2 * b2, p23 + a2 * b3
        p30, p31, p32, p33 = p30 + a3 * b0, p31 + a3 * b1, p32 + a3 * b2, p33 + a3 * b3
    r, c = TILE * i, TILE * j
    products[r, c], products[r, c + 1], products[r, c + 2], products[r, c + 3] = p00, p01, p02, p03
    products[r + 1, c], products[r + 1, c + 1], products[r + 1, c + 2], products[r + 1, c + 3] = p10, p11, p12, p13
    products[r + 2, c], products[r + 2, c + 1], products[r + 2, c + 2], products[r + 2, c + 3] = p20, p21, p22, p23
    products[r + 3, c], products[r + 3, c + 1], products[r + 3, c + 2], products[r + 3, c + 3] = p30, p31, p32, p33


@inlined
def sum_half_tile(terms: Array, i: int, pixels: int, products: Array) -> None:
    """As `sum_tile` of a block with itself, of which only the lower half is summed up."""
    p00 = p10 = p11 = p20 = p21 = p22 = p30 = p31 = p32 = p33 = 0.0
    for x in range(pixels):
        a0, a1, a2, a3 = terms[i, x, 0], terms[i, x, 1], terms[i, x, 2], terms[i, x, 3]
        p00, p10, p11, p20, p21 = p00 + a0 * a0, p10 + a1 * a0, p11 + a1 * a1, p20 + a2 * a0, p21 + a2 * a1
        p22, p30, p31, p32, p33 = p22 + a2 * a2, p30 + a3 * a0, p31 + a3 * a1, p32 + a3 * a2, p33 + a3 * a3
    r = TILE * i
    products[r, r], products[r + 1, r], products[r + 1, r + 1] = p00, p10, p11
    products[r + 2, r], products[r + 2, r + 1], products[r + 2, r + 2] = p20, p21, p22
    products[r + 3, r], products[r + 3, r + 1] = p30, p31
    products[r + 3, r + 2], products[r + 3, r + 3] = p32, p33


@inlined
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


@inlined
def fit_step(image: Image, edges: Array, start: float, strip: Strip, colour: Array, sums: Sums) -> Step:
    """The step of a control point's edge around distance `start`, fitted together with those beside it.

    Arguments as of `sums_of_steps`. NO_STEP without a step in the direction `colour`, or too few pixels; otherwise the
    derivatives of the distance for the response are in `sums`.
    """
    steps, n = len(edges), sums_of_steps(image, edges, start, strip, colour, sums)
    if n < 3 * ACROSS:
        return NO_STEP
    products, last, rows = sums.products, 2 * steps + 1, len(sums.by_response)
    if steps == 1 and rows == 0:
        return fit_alone(products, n, start, strip.optics.light[0, 1])
    for i in range(last + 1, last + 1 + rows):  # the level is eliminated
        for j in range(last):
            products[i, j] -= products[i, last] * products[last, j] / n
    for i in range(last):
        for j in range(i + 1):
            products[i, j] -= products[last, i] * products[last, j] / n
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
    noise = max(0.0, products[light, light] - explained) / (n - steps - 2)
    for r in range(rows):  # at the minimum, where the shift is linear in the light
        row, moved = last + 1 + r, 0.0
        for i in range(steps):
            moved -= height[i] * products[row, 2 * i + 1]
            x[i] = products[row, 2 * i] - shift * products[row, 2 * i + 1]
            for k in range(i):
                x[i] -= A[i, k] * x[k]
            x[i] *= A[i, i]
        for i in range(steps):
            moved -= A[steps, i] * x[i]
        sums.by_response[r] = -moved * A[steps, steps]
    return Step(start + shift, noise * A[steps, steps])


@inlined
def fit_alone(products: Array, n: int, start: float, least: float) -> Step:
    """As `fit_step` of one step, from the products of n pixels, whose height must be more than `least`.

    The same operations in the same order, number by number: most edges stand alone.
    """
    HH, SH, SS = products[0, 0], products[1, 0], products[1, 1]
    LH, LS, LL = products[2, 0], products[2, 1], products[2, 2]
    of_H, of_S, of_L = products[3, 0], products[3, 1], products[3, 2]
    HH, SH, SS = HH - of_H * of_H / n, SH - of_S * of_H / n, SS - of_S * of_S / n  # the level is eliminated
    LH, LS, LL = LH - of_L * of_H / n, LS - of_L * of_S / n, LL - of_L * of_L / n
    height, shift, explained, variance = 0.0, 0.0, 0.0, 0.0
    for iteration in range(ITERATIONS):
        cross = SH - shift * SS
        A, B = HH - shift * SH - shift * cross + HEIGHT_INFORMATION, 0.0 - height * cross
        C = 1.0 if iteration == 0 else height * height * SS
        x, y = LH - shift * LS, 0.0 - height * LS
        if not A > 0.0:
            return NO_STEP
        A = 1.0 / A
        C -= B * B * A
        if not C > 0.0:
            return NO_STEP
        variance = 1.0 / C
        explained = x * x * A
        x *= A
        y -= B * x
        explained += y * y * variance
        y *= variance
        height = x - A * B * y
        shift += y
        if not (explained >= 0.0 and abs(shift) < 2 * MAX_SHIFT_PX):
            return NO_STEP
    if not height > least:
        return NO_STEP
    return Step(start + shift, max(0.0, LL - explained) / (n - 3) * variance)
