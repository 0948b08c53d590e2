"""Compiled subpixel edges: near the right pose, steps of light fitted to all pixels about each control point."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from uavbench.tracker.robust.edges.neighbour_kernels import NEIGHBOURS, Neighbours
from uavbench.tracker.robust.edges.profile_fit_kernels import (
    INITIAL_BLUR_PX,
    LEAST_BLUR_PX,
    LIGHT,
    MOST_BLUR_PX,
    MOST_STEPS,
    REACH_PX,
    WORKSPACE,
    Workspace,
    fit_steps,
    workspace,
)
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.kernel_values import kernel_type
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

CROWDED_PX = REACH_PX + 3 * INITIAL_BLUR_PX
"""Edges nearer than this blur into the pixels of a profile: three standard deviations beyond its end."""
LEAST_ALONG_PX = 2
"""Scan lines to either side of a control point, also where points are so close that their strips touch."""
SUBPIXEL = kernel_type(SubpixelConfig)


class FittedPoints(NamedTuple):
    """Control points after a fit: signed residual (n,) in px, weight (n,) in it, variance_px2 (n,) before it.

    offset_px2 (n,) is the prior variance of the offset of their edge, blur_px the standard deviation of the image's
    blur.
    """

    residual: Array
    weight: Array
    variance_px2: Array
    offset_px2: Array
    blur_px: float


class SubpixelEdges(NamedTuple):
    """Distance (n, 1) of each control point's edge from its search line's middle, px, and its variance_px2 (n,).

    steps (n,) of light that were fitted together for it, 0 where none could be. blur_px that edges alone tell.
    """

    distance: Array
    variance_px2: Array
    steps: NDArray[np.int64]
    blur_px: float


FITTED_POINTS = named_tuple(FittedPoints, "f1! f1! f1! f1! f0")


@compiled(
    "u3 lines points near f2 fitted subpixel",
    lines=SEARCH_LINES,
    points=CONTROL_POINTS,
    near=NEIGHBOURS,
    fitted=FITTED_POINTS,
    subpixel=SUBPIXEL,
)
def refine_subpixel(
    image: Image,
    at: SearchLines,
    points: ControlPoints,
    near: Neighbours,
    appearance: Array,
    fitted: FittedPoints,
    config: SubpixelConfig,
) -> SubpixelEdges:
    """Sub-pixel refinement: where blurred steps fit the pixels about each control point.

    Where none can be fitted, distance and variance are those of `fitted`, and the distance is inf where the weight
    is 0.
    """
    lines, side, rows, first = at.lines, at.side, points.rows, points.first
    residual, weights = fitted.residual, fitted.weight
    distance, variance = np.full((len(lines), 1), np.inf), fitted.variance_px2.copy()
    steps = np.zeros(len(lines), np.int64)
    colour, work = np.empty(3), workspace(MOST_STEPS, fitted.blur_px)
    for g in range(len(first) - 1):
        mean, total = 0.0, 0.0
        for p in range(first[g], first[g + 1]):
            if weights[p] > 0.0:
                mean, total = mean + weights[p] * residual[p], total + weights[p]
        mean /= max(total, 1e-12)
        for p in range(first[g], first[g + 1]):
            if not weights[p] > 0.0:
                continue
            distance[p, 0] = residual[p]
            step = learned_light(appearance[rows[p]], image.shape[2], colour)
            if side[p] == OUTSIDE or not step > 0.0:
                continue
            alone = not abs(near.across_px[p, 0]) < CROWDED_PX
            start = mean if alone else 0.0  # the search took the steps of neighbours for the edge's own
            count = gather_steps(lines, p, near, start, fitted.offset_px2, work)
            if count > MOST_STEPS:
                continue
            along = max(LEAST_ALONG_PX, min(config.half_length_px // count, int(points.half_px[p]) - 1))
            found = fit_steps(image, count, along, colour, work)
            if abs(found.distance) < fitted.blur_px:  # linear in the shift, and right within one standard deviation
                distance[p, 0], steps[p] = start + found.distance, count
                variance[p] = config.variance_px2 + found.variance_px2 + appearance[rows[p], MEAN_SQUARE]
    blur_px = fitted.blur_px + (work.blur[2] / work.blur[1] if work.blur[1] > 0.0 else 0.0)
    return SubpixelEdges(distance, variance, steps, min(MOST_BLUR_PX, max(LEAST_BLUR_PX, blur_px)))


@compiled("f2 i0 near f0 f1 work", inner=True, near=NEIGHBOURS, work=WORKSPACE)
def gather_steps(lines: Array, p: int, near: Neighbours, start: float, offset_px2: Array, work: Workspace) -> int:
    """Put the line of a control point and those of its neighbours, all `start` px farther along its normal, to work.

    Returns how many there are; of more than MOST_STEPS the nearest ones are there.
    """
    nu, nv = lines[p, NORMAL_U], lines[p, NORMAL_V]
    steps = work.lines
    steps[0, U], steps[0, V] = lines[p, U] + start * nu, lines[p, V] + start * nv
    steps[0, NORMAL_U], steps[0, NORMAL_V] = nu, nv
    count = 1
    for k in range(near.rows.shape[1]):
        q, across = near.rows[p, k], near.across_px[p, k]
        if q < 0 or not abs(across) < CROWDED_PX:
            break
        if count == MOST_STEPS:
            return count + 1
        mu, mv = lines[q, NORMAL_U], lines[q, NORMAL_V]
        if nu * mu + nv * mv < 0.0:
            mu, mv = -mu, -mv
        steps[count, U], steps[count, V] = steps[0, U] + across * nu, steps[0, V] + across * nv
        steps[count, NORMAL_U], steps[count, NORMAL_V] = mu, mv
        work.apart_px2[count] = offset_px2[p] + offset_px2[q]
        count += 1
    return count


@compiled("f1 i0 f1!", inner=True)
def learned_light(row: Array, channels: int, colour: Array) -> float:
    """Learned step of light of an edge, 0 where nothing is learned; its direction in the channels' space in colour."""
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
