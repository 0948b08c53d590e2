"""Compiled sub-pixel refinement: a blurred step of linear intensity is fitted to the pixels around each control point.

Near an edge the intensity is a + b H(s), with s the distance across it and H a step blurred by pixel and lens. Shifted
by d it is a + b H(s) - b d H'(s), linear in a, b and b d: a linear least-squares problem, whose residual gives the
variance of d.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.robust.config.edges import SubpixelConfig
from uavbench.tracker.robust.edges.columns import (
    MEAN_SQUARE,
    NEGATIVE_COLOUR,
    NORMAL_U,
    NORMAL_V,
    OUTSIDE,
    POSITIVE_COLOUR,
    TIMES_SEEN,
    U,
    V,
)
from uavbench.tracker.robust.edges.measurements import (
    CONTROL_POINTS,
    SEARCH_LINES,
    ControlPoints,
    SearchLines,
)
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CODES = np.arange(256) / 255
LIGHT = np.where(CODES <= 0.04045, CODES / 12.92, ((CODES + 0.055) / 1.055) ** 2.4)
"""Linear intensity of sRGB codes (IEC 61966-2-1), which is what pixels integrate."""
LEAST_STEP = float(LIGHT[1])
"""Least intensity step: that of one code."""
BLUR_PX = 0.5
"""Standard deviation of H': 0.29 px of the pixel area, in any direction, and 0.4 px of a sharp lens."""
CLEARANCE_PX = 3 * BLUR_PX
"""Reach of the blur of a neighbouring edge: three standard deviations."""
MAX_SHIFT_PX = BLUR_PX
"""Largest shift: the linearized fit is valid within one standard deviation of the blur."""
MIN_REACH_PX, MAX_REACH_PX = 2, 3
"""Pixels to either side of the edge on a scan line: fewer do not determine a step and two levels, more add little.
"""
ALONG_PX = 2
"""Scan lines to either side of a control point; points are about 6 px apart, so that these do not overlap."""
TABLE_PX, STEPS_PER_PX = MAX_REACH_PX + 1, 64
AT = np.arange(-TABLE_PX * STEPS_PER_PX, TABLE_PX * STEPS_PER_PX + 1) / STEPS_PER_PX
STEP = np.array([0.5 * (1 + math.erf(s / (math.sqrt(2) * BLUR_PX))) for s in AT])
SLOPE = np.exp(-0.5 * np.square(AT / BLUR_PX)) / (math.sqrt(2 * math.pi) * BLUR_PX)
"""H and H' at AT."""
SUBPIXEL = kernel_type(SubpixelConfig)


class FittedPoints(NamedTuple):
    """Control points after a fit: signed residual (n,) in px, weight (n,) in it, variance_px2 (n,) before it."""

    residual: Array
    weight: Array
    variance_px2: Array


class SubpixelEdges(NamedTuple):
    """Distance (n, 1) of each control point's edge from its search line's middle, px, and its variance_px2 (n,)."""

    distance: Array
    variance_px2: Array


class Step(NamedTuple):
    """Distance of a step in px along a normal, and its variance in px^2."""

    distance: float
    variance_px2: float


NO_STEP = Step(np.inf, np.inf)
FITTED_POINTS = named_tuple(FittedPoints, "f1! f1! f1!")


@compiled(
    "u3 lines points f2 f1 fitted subpixel",
    lines=SEARCH_LINES,
    points=CONTROL_POINTS,
    fitted=FITTED_POINTS,
    subpixel=SUBPIXEL,
)
def refine_subpixel(
    image: Image,
    at: SearchLines,
    points: ControlPoints,
    appearance: Array,
    spacing: Array,
    fitted: FittedPoints,
    config: SubpixelConfig,
) -> SubpixelEdges:
    """Sub-pixel refinement: position of a blurred step fitted to the pixels around each control point.

    If no step can be fitted, distance and variance are those of `fitted`, with an infinite distance for a weight of 0.
    spacing (n,): distance in px to another edge.
    """
    lines, side, rows, first = at.lines, at.side, points.rows, points.first
    residual, weights = fitted.residual, fitted.weight
    distance, variance = np.empty((len(lines), 1)), fitted.variance_px2.copy()
    distance[:] = np.inf
    colour = np.empty(3)
    for g in range(len(first) - 1):
        start, total = 0.0, 0.0
        for p in range(first[g], first[g + 1]):
            if weights[p] > 0.0:
                start, total = start + weights[p] * residual[p], total + weights[p]
        start /= max(total, 1e-12)
        for p in range(first[g], first[g + 1]):
            if not weights[p] > 0.0:
                continue
            distance[p, 0] = residual[p]
            step = learned_light(appearance[rows[p]], image.shape[2], colour)
            reach = min(MAX_REACH_PX, int(spacing[p] - CLEARANCE_PX))
            if side[p] != OUTSIDE and step > 0.0 and reach >= MIN_REACH_PX:
                found = fit_step(image, lines[p], start, reach, ALONG_PX, colour)
                if abs(found.distance - start) < MAX_SHIFT_PX:
                    distance[p, 0] = found.distance
                    variance[p] = config.variance_px2 + found.variance_px2 + appearance[rows[p], MEAN_SQUARE]
    return SubpixelEdges(distance, variance)


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


@compiled("u3 f1 f0 i0 i0 f1", inner=True)
def fit_step(image: Image, line: Array, start: float, reach: int, along: int, colour: Array) -> Step:
    """The intensity step on a search line (4,) around distance `start`; inf without one in the direction `colour`.

    Uses the scan lines, rows or columns, that cross the edge more steeply: `along` of them to either side, and `reach`
    pixels of each to either side of the edge.
    """
    h, w, channels = image.shape
    nu, nv = line[NORMAL_U], line[NORMAL_V]
    u, v = line[U] + start * nu, line[V] + start * nv
    by_rows = abs(nu) >= abs(nv)
    if by_rows:
        x0, y0, nx, ny, width, height = u, v, nu, nv, w, h
    else:
        x0, y0, nx, ny, width, height = v, u, nv, nu, h, w
    middle = int(y0 + 0.5)
    n, s01, s02, s11, s12, s22, t0, t1, t2, tt = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for y in range(max(0, middle - along), min(height, middle + along + 1)):
        x = x0 - (y - y0) * ny / nx
        low = int(x + 0.5) - reach
        if low < 0 or low + 2 * reach >= width:
            continue
        for j in range(low, low + 2 * reach + 1):
            k = int(((j - x) * nx + TABLE_PX) * STEPS_PER_PX + 0.5)
            g, d, f = STEP[k], SLOPE[k], 0.0
            for c in range(channels):
                f += colour[c] * LIGHT[image[y, j, c] if by_rows else image[j, y, c]]
            s01, s02 = s01 + g, s02 + d
            s11, s12, s22 = s11 + g * g, s12 + g * d, s22 + d * d
            t0, t1, t2, tt = t0 + f, t1 + f * g, t2 + f * d, tt + f * f
            n += 1
    if n < 3 * (2 * reach + 1):
        return NO_STEP
    a11, a12, a22 = s11 - s01 * s01 / n, s12 - s01 * s02 / n, s22 - s02 * s02 / n
    b1, b2 = t1 - s01 * t0 / n, t2 - s02 * t0 / n
    det = a11 * a22 - a12 * a12
    step, slope = (b1 * a22 - b2 * a12) / det, (b2 * a11 - b1 * a12) / det
    if not step > LEAST_STEP:
        return NO_STEP
    noise = max(0.0, tt - t0 * t0 / n - step * b1 - slope * b2) / (n - 3)
    return Step(start - slope / step, noise * a11 / det / (step * step))
