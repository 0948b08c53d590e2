"""Compiled fit of blurred steps of linear light to the pixels around a control point.

Near an edge the light is a + b H(s), with s the distance across it and H a step blurred by pixel and lens. Within a few
pixels lie others: the borders of a reveal, of a flange, of lattice members. All of them are moved by the same error of
the pose, so that the light is a + sum_k b_k H(s_k - d): least squares in the level a, the heights b_k and the one shift
d, whose residual gives the variance of d.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import cholesky
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
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255
LIGHT = np.where(CODES <= 0.04045, CODES / 12.92, ((CODES + 0.055) / 1.055) ** 2.4)
"""Linear intensity of sRGB codes (IEC 61966-2-1), which is what pixels integrate."""
LEAST_STEP = float(LIGHT[1])
"""Least intensity step: that of one code."""
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
WIDTHS, STEPS_PER_WIDTH = 5, 64
AT = np.arange(-WIDTHS * STEPS_PER_WIDTH, WIDTHS * STEPS_PER_WIDTH + 1) / STEPS_PER_WIDTH
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
ITERATIONS = 3
"""Of Gauss-Newton: the heights, then the shift with them, then both."""


class Step(NamedTuple):
    """Distance of a step in px along a normal, and its variance in px^2."""

    distance: float
    variance_px2: float


class Strip(NamedTuple):
    """Pixels about a control point: about `beside` scan lines to either side, spread over `along` px; their blur_px."""

    along: int
    beside: int
    blur_px: float


NO_STEP = Step(np.inf, np.inf)
STRIP = named_tuple(Strip, "i0 i0 f0")


@compiled("f1 i0 f1!", inner=True)
def learned_light(row: Array, channels: int, colour: Array) -> float:
    """Learned intensity step of an edge, 0 if nothing is learned; its direction in colour space goes into `colour`."""
    colour[:] = 0.0
    if not row[TIMES_SEEN] > 0.0:
        return 0.0
    square = 0.0
    for c in range(channels):
        high, low = row[POSITIVE_COLOUR + c], row[NEGATIVE_COLOUR + c]
        colour[c] = LIGHT[min(255, int(high + 0.5))] - LIGHT[min(255, int(low + 0.5))]
        square += colour[c] * colour[c]
    step = math.sqrt(square)
    if step > 0.0:
        for c in range(channels):
            colour[c] /= step
    return step


@compiled("u3 f2! f0 strip f1 f2!", inner=True, strip=STRIP)
def sums_of_steps(image: Image, edges: Array, start: float, strip: Strip, colour: Array, sums: Array) -> int:
    """Number of pixels around a control point whose steps and light are summed up.

    edges (k, 4): pixel and normal of the point's edge and of those beside it, all moved by `start` px. The pixels are
    on scan lines, rows or columns, that cross the edge more steeply: about `beside` to either side of the point, spread
    over `along` px. sums: its first 2 k + 2 rows and columns get, in the lower half, the sums of the products of H and
    H' of each step, of the light, and of 1.
    """
    h, w, channels = image.shape
    along, beside, widths_per_px = strip.along, strip.beside, 1.0 / strip.blur_px
    nu, nv = edges[0, NORMAL_U], edges[0, NORMAL_V]
    u, v = edges[0, U] + start * nu, edges[0, V] + start * nv
    by_rows = abs(nu) >= abs(nv)
    if by_rows:
        x0, y0, nx, ny, width, height = u, v, nu, nv, w, h
    else:
        x0, y0, nx, ny, width, height = v, u, nv, nu, h, w
    steps, n = len(edges), 0
    size = 2 * steps + 2
    term = np.empty(size)
    for i in range(size):
        for j in range(i + 1):
            sums[i, j] = 0.0
    middle, every = int(y0 + 0.5), max(1, (along + beside - 1) // beside)
    for k in range(-(along // every), along // every + 1):
        y = middle + k * every
        low = int(x0 - (y - y0) * ny / nx + 0.5) - REACH_PX
        if y < 0 or y >= height or low < 0 or low + 2 * REACH_PX >= width:
            continue
        for x in range(low, low + 2 * REACH_PX + 1):
            column, row = (x, y) if by_rows else (y, x)
            for i in range(steps):
                away = (column - edges[i, U]) * edges[i, NORMAL_U] + (row - edges[i, V]) * edges[i, NORMAL_V] - start
                away *= widths_per_px
                at = int((min(max(away, -WIDTHS), WIDTHS) + WIDTHS) * STEPS_PER_WIDTH + 0.5)
                term[2 * i], term[2 * i + 1] = STEP[at], SLOPE[at] * widths_per_px
            light = 0.0
            for c in range(channels):
                light += colour[c] * LIGHT[image[row, column, c]]
            term[size - 2], term[size - 1] = light, 1.0
            for i in range(size):
                for j in range(i + 1):
                    sums[i, j] += term[i] * term[j]
            n += 1
    return n


@compiled("f2! f1!", inner=True)
def solve(A: Array, x: Array) -> bool:
    """Solve A y = x in place: x becomes y, A its Cholesky factor; False where it is not positive."""
    if not cholesky(A, A):
        return False
    n = len(x)
    for i in range(n):
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[k, i] * x[k]
        x[i] /= A[i, i]
    return True


@compiled("u3 f2! f0 strip f1 f2!", inner=True, strip=STRIP)
def fit_step(image: Image, edges: Array, start: float, strip: Strip, colour: Array, sums: Array) -> Step:
    """The step of a control point's edge around distance `start`, fitted together with those beside it.

    Arguments as of `sums_of_steps`. NO_STEP without a step in the direction `colour`, or too few pixels.
    """
    steps, n = len(edges), sums_of_steps(image, edges, start, strip, colour, sums)
    if n < 3 * (2 * REACH_PX + 1):
        return NO_STEP
    last = 2 * steps + 1
    for i in range(last):  # the level is eliminated
        for j in range(i + 1):
            sums[i, j] -= sums[last, i] * sums[last, j] / n
            sums[j, i] = sums[i, j]
    light = 2 * steps
    A, x, height = np.empty((steps + 1, steps + 1)), np.empty(steps + 1), np.zeros(steps)
    shift, information, explained = 0.0, 0.0, 0.0
    for iteration in range(ITERATIONS):
        A[steps, steps] = x[steps] = 0.0
        for i in range(steps):
            at, slope = 2 * i, 2 * i + 1
            x[i] = sums[at, light] - shift * sums[slope, light]
            x[steps] -= height[i] * sums[slope, light]
            A[steps, i] = 0.0
            for j in range(steps):
                cross = sums[at, 2 * j + 1] - shift * sums[slope, 2 * j + 1]
                A[steps, i] -= height[j] * cross
                A[steps, steps] += height[i] * height[j] * sums[slope, 2 * j + 1]
                A[i, j] = sums[at, 2 * j] - shift * sums[slope, 2 * j] - shift * cross
            A[i, i] += HEIGHT_INFORMATION
        if iteration == 0:
            A[steps, steps] = 1.0  # without heights the light says nothing of the shift, which stays 0
        explained, right = 0.0, x.copy()
        if not solve(A, x):
            return NO_STEP
        for i in range(steps + 1):
            explained += right[i] * x[i]
        for i in range(steps):
            height[i] = x[i]
        shift, information = shift + x[steps], A[steps, steps] ** 2
        if not abs(shift) < 2 * MAX_SHIFT_PX:  # it diverges
            return NO_STEP
    whole = height[0]
    for i in range(1, steps):
        across = (edges[i, U] - edges[0, U]) * edges[0, NORMAL_U] + (edges[i, V] - edges[0, V]) * edges[0, NORMAL_V]
        if abs(across) < TOGETHER_WIDTHS * strip.blur_px:
            whole += height[i]
    if not whole > LEAST_STEP:
        return NO_STEP
    noise = max(0.0, sums[light, light] - explained) / (n - steps - 2)
    return Step(start + shift, noise / information)
