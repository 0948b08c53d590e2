"""Compiled sums of products of blurred steps and the light, over the pixels around a control point.

Near an edge the light is a + b H(s), with s the distance across it and H a step blurred by pixel and lens: that of a
normal distribution, but for the area of a pixel, which is even. The sums are what least squares needs of the pixels.
They take most of the time of a sub-pixel fit, and are summed up in tiles.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.optics_kernels import BLOWN_OUT, Optics
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

REACH_PX = 3
"""Pixels to either side of the edge on a scan line: fewer do not determine a step and two levels, more add little."""
ACROSS = 2 * REACH_PX + 1
"""Pixels of a scan line."""
WIDTHS, STEPS_PER_WIDTH = 5, 64
MIDDLE = WIDTHS * STEPS_PER_WIDTH
AT = np.arange(-MIDDLE, MIDDLE + 1) / STEPS_PER_WIDTH
STEP = np.array([0.5 * (1 + math.erf(s / math.sqrt(2))) for s in AT])
SLOPE = np.exp(-0.5 * np.square(AT)) / math.sqrt(2 * math.pi)
"""H and H' of a normal blur at AT, in standard deviations of it."""
RAMP = AT * STEP + SLOPE
"""The integral of H there."""
LEAST_REST_PX = 0.05
"""Least standard deviation of what else than pixels blurs an edge: that of a lens so sharp is not told."""
TILE = 4
"""Rows and columns of the products that are summed up together, which the registers of a processor hold."""


class Strip(NamedTuple):
    """Pixels about a control point: about `beside` scan lines to either side, spread over `along` px; their optics."""

    along: int
    beside: int
    optics: Optics


class Sums(NamedTuple):
    """Arrays that a fit of up to k steps writes, made once for many fits.

    terms (m, p, TILE): in so many blocks of columns, at each of p pixels, H and H' of each step, the light, 1, and the
    light's derivatives. products (TILE m, TILE m): its lower half is their sums over all pixels. A (k + 1, k + 1),
    x (k + 1,): normal equations of the heights and the shift. height (k,). shares (k,): derivatives of the shift for
    those of each step. by_response (r,): derivatives of the shift. misfit (ACROSS,): see `write_misfit`. lines (n, 2):
    first pixel and number of each scan line.
    """

    terms: Array
    products: Array
    A: Array
    x: Array
    height: Array
    shares: Array
    by_response: Array
    misfit: Array
    lines: Array


class Scan(NamedTuple):
    """How an edge crosses the scan lines of an image, rows or columns: place and normal along and across a line, and
    how many pixels a line has, and how many lines there are.
    """

    by_rows: bool
    x0: float
    y0: float
    nx: float
    ny: float
    width: int
    height: int


class EdgeBlur(NamedTuple):
    """The blur of an edge: even over the longer extent of a pixel across it, and normal for the rest.

    per_rest: inverse of the standard deviation of the rest, 1/px; half: half of that extent in such deviations, and
    per_half its inverse; reach_px: distance from the edge beyond which there is nothing of the blur.
    """

    per_rest: float
    half: float
    per_half: float
    reach_px: float


class StepAt(NamedTuple):
    """A blurred step of height 1, and its slope per pixel."""

    step: float
    slope: float


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
        np.empty(steps),
        np.empty(derivatives),
        np.empty(ACROSS),
        np.empty((2 * beside + 1, 2), np.int64),
    )


@inlined(allocates=False)
def blur_of(nu: float, nv: float, blur_px: float) -> EdgeBlur:
    """The blur of an edge of this normal in an image of this blur, the standard deviation of all of it.

    A pixel's area is even; across an edge it has the extents of its width and height, independent of each other.
    """
    width = max(abs(nu), abs(nv))
    rest = math.sqrt(max(LEAST_REST_PX * LEAST_REST_PX, blur_px * blur_px - width * width / 12.0))
    return EdgeBlur(1.0 / rest, 0.5 * width / rest, 2.0 * rest / width, 0.5 * width + WIDTHS * rest)


@inlined(allocates=False)
def step_at(away_px: float, blur: EdgeBlur) -> StepAt:
    """H and H' so many px beyond an edge."""
    if abs(away_px) >= blur.reach_px:
        return StepAt(1.0 if away_px > 0.0 else 0.0, 0.0)
    z, half = away_px * blur.per_rest, blur.half
    low, high = nearest_row(z - half), nearest_row(z + half)
    beside_low, beside_high = z - half - AT[low], z + half - AT[high]
    ramp = RAMP[high] + beside_high * STEP[high] - RAMP[low] - beside_low * STEP[low]
    step = STEP[high] + beside_high * SLOPE[high] - STEP[low] - beside_low * SLOPE[low]
    return StepAt(0.5 * blur.per_half * ramp, 0.5 * blur.per_half * blur.per_rest * step)


@inlined(allocates=False)
def nearest_row(z: float) -> np.uint32:
    """Row of the tables that is next to so many standard deviations."""
    return np.uint32(min(max(z * STEPS_PER_WIDTH + MIDDLE, 0.0), 2.0 * MIDDLE) + 0.5)


@inlined(allocates=False)
def scan_across(image: Image, edge: Array, start: float) -> Scan:
    """The scan lines of an image that cross an edge (4,), moved by `start` px, more steeply."""
    nu, nv = edge[NORMAL_U], edge[NORMAL_V]
    u, v = edge[U] + start * nu, edge[V] + start * nv
    if abs(nu) >= abs(nv):
        return Scan(True, u, v, nu, nv, image.shape[1], image.shape[0])
    return Scan(False, v, u, nv, nu, image.shape[0], image.shape[1])


@inlined(allocates=False)
def crossed_at(scan: Scan, y: int) -> float:
    """Where the edge crosses a scan line."""
    return scan.x0 - (y - scan.y0) * scan.ny / scan.nx


@inlined(allocates=False)
def first_pixel(scan: Scan, crossed: float) -> int:
    """First of the ACROSS pixels about a place of a scan line, -1 where they are not all in the image."""
    low = int(crossed + 0.5) - REACH_PX
    return low if low >= 0 and low + ACROSS <= scan.width else -1


@inlined(allocates=False)
def sums_of_steps(
    image: Image, edges: Array, start: float, strip: Strip, colour: Array, is_even: bool, sums: Sums
) -> int:
    """Number of pixels around a control point whose steps and light are summed up.

    edges (k, 4): pixel and normal of the point's edge and of those beside it, all moved by `start` px. The pixels are
    on scan lines, rows or columns, that cross the edge more steeply: about `beside` to either side of the point, spread
    over `along` px. is_even: whether pixels have an even area; otherwise all of the blur is taken for normal. The first
    2 k + 2 + r rows of the products in `sums` become those of these pixels; of pixels that are blown out all terms are
    0, since their light is not known.
    """
    scan, lines, pixels = scan_across(image, edges[0], start), sums.lines, 0
    middle, every = int(scan.y0 + 0.5), max(1, (strip.along + strip.beside - 1) // strip.beside)
    for k in range(-(strip.along // every), strip.along // every + 1):
        y = middle + k * every
        if y < 0 or y >= scan.height:
            continue
        low = first_pixel(scan, crossed_at(scan, y))
        if low >= 0:
            lines[pixels // ACROSS, 0], lines[pixels // ACROSS, 1] = low, y
            pixels += ACROSS
    crossed = lines[: pixels // ACROSS]
    for i in range(len(edges)):
        if is_even:
            write_even_step(edges, i, start, strip.optics.blur_px, scan.by_rows, crossed, sums.terms)
        else:
            write_normal_step(edges, i, start, strip.optics.blur_px, scan.by_rows, crossed, sums.terms)
    write_light(image, len(edges), strip.optics.light, colour, scan.by_rows, crossed, sums.terms)
    for i in range((2 * len(edges) + 2 + len(strip.optics.light) - 1 + TILE - 1) // TILE):
        for j in range(i):
            sum_tile(sums.terms, i, j, pixels, sums.products)
        sum_half_tile(sums.terms, i, pixels, sums.products)
    return pixels


@inlined(allocates=False)
def write_even_step(
    edges: Array, i: int, start: float, blur_px: float, by_rows: bool, lines: Array, terms: Array
) -> None:
    """Write H and H' of an edge of (k, 4), blurred by pixels of an even area, at all pixels of scan lines (n, 2)."""
    u0, v0, nu, nv = edges[i, U], edges[i, V], edges[i, NORMAL_U], edges[i, NORMAL_V]
    each_px, blur, block, column = nu if by_rows else nv, blur_of(nu, nv, blur_px), i // 2, 2 * (i % 2)
    for k in range(len(lines)):
        u, v = (lines[k, 0], lines[k, 1]) if by_rows else (lines[k, 1], lines[k, 0])
        away = (u - u0) * nu + (v - v0) * nv - start
        for x in range(ACROSS):
            at = step_at(away + x * each_px, blur)
            terms[block, ACROSS * k + x, column], terms[block, ACROSS * k + x, column + 1] = at.step, at.slope


@inlined(allocates=False)
def write_normal_step(
    edges: Array, i: int, start: float, blur_px: float, by_rows: bool, lines: Array, terms: Array
) -> None:
    """As `write_even_step`, of a blur that is normal."""
    u0, v0, nu, nv = edges[i, U], edges[i, V], edges[i, NORMAL_U], edges[i, NORMAL_V]
    each_px, widths_per_px, block, column = nu if by_rows else nv, 1.0 / blur_px, i // 2, 2 * (i % 2)
    for k in range(len(lines)):
        u, v = (lines[k, 0], lines[k, 1]) if by_rows else (lines[k, 1], lines[k, 0])
        away = (u - u0) * nu + (v - v0) * nv - start
        for x in range(ACROSS):
            near = nearest_row((away + x * each_px) * widths_per_px)
            terms[block, ACROSS * k + x, column] = STEP[near]
            terms[block, ACROSS * k + x, column + 1] = SLOPE[near] * widths_per_px


@inlined(allocates=False)
def write_light(
    image: Image, steps: int, light_of: Array, colour: Array, by_rows: bool, lines: Array, terms: Array
) -> None:
    """Write the light of all pixels of scan lines (n, 2), 1, and the light's derivatives, after the terms of so many
    steps; where a pixel is blown out all of its terms are 0.
    """
    for k in range(len(lines)):
        low, y, pixels, brightest = lines[k, 0], lines[k, 1], ACROSS * k, 0
        for r in range(len(light_of)):
            at_block, at_column = divmod(2 * steps + (1 + r if r > 0 else 0), TILE)
            for x in range(ACROSS):
                column, row = (low + x, y) if by_rows else (y, low + x)
                light = 0.0
                for c in range(image.shape[2]):
                    code = image[row, column, c]
                    brightest = max(brightest, int(code))
                    light += colour[c] * light_of[r, code]
                terms[at_block, pixels + x, at_column] = light
        at_block, at_column = divmod(2 * steps + 1, TILE)
        terms[at_block, pixels : pixels + ACROSS, at_column] = 1.0
        if brightest >= BLOWN_OUT:
            leave_out_blown(image, by_rows, low, y, colour, terms[:, pixels : pixels + ACROSS])


@inlined(allocates=False)
def leave_out_blown(image: Image, by_rows: bool, low: int, y: int, colour: Array, terms: Array) -> None:
    """Make 0 all terms (m, ACROSS, TILE) of the pixels of a scan line that are blown out in a channel that counts."""
    for x in range(ACROSS):
        column, row = (low + x, y) if by_rows else (y, low + x)
        blown_out = False
        for c in range(image.shape[2]):
            blown_out = blown_out or (colour[c] != 0.0 and image[row, column, c] >= BLOWN_OUT)
        if blown_out:
            for block in range(len(terms)):
                for k in range(TILE):
                    terms[block, x, k] = 0.0


@inlined(allocates=False)
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


@inlined(allocates=False)
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
