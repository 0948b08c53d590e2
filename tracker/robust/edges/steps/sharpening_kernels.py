"""Compiled measurement of how much an image was sharpened, by the steps of edges that stand alone.

The light about such an edge is fitted by a step, its slope, what another blur would add to it, and what an unsharp mask
would: the same step less the mean of two of it, as far to either side as the mask reaches.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.blur_kernels import ALONG_PX, LEAST_MEASURED, measured_points
from uavbench.tracker.robust.edges.steps.optics_kernels import (
    OPTICS,
    PIXEL_PX,
    Optics,
    learned_light,
    without_derivatives,
)
from uavbench.tracker.robust.edges.steps.step_kernels import solve
from uavbench.tracker.robust.edges.steps.sum_kernels import Strip, room_for, sums_of_steps
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

BOX_PX, TIMES = 3, 2
"""Pixels of a box across, and how often its mean is taken: together a blur of REACH_PX, in a third of the time of a
Gaussian."""
REACH_PX = math.sqrt(TIMES * (BOX_PX**2 - 1) / 12)
"""Standard deviation of the blur with which an image is mixed to undo sharpening: between that of an unsharp mask of
1 px, the usual one, and what is left of it once it is undone, which is wider by the square root of 1 + amount."""
COMPONENTS = 5
"""Steps of light: the edge's own, a blur to either side of it, and a reach of sharpening to either side."""
TERMS = np.zeros((4, 2 * COMPONENTS))
"""What the light is fitted by beside its level, of the steps and their slopes: height, shift, blur and sharpening."""
TERMS[0, 0] = TERMS[1, 1] = 1.0
TERMS[2, [0, 2, 4]] = TERMS[3, [0, 6, 8]] = -1.0, 0.5, 0.5
UNLIKELY = 1e-4
"""Prior information on what blur adds to a step, in light: decides where it is hardly told from sharpening."""
UNLIKELY_AMOUNT = 2e-3
"""Prior information on the amount of sharpening, of a step of height 1: steps differ from what is fitted to them by a
fiftieth of their height, alike on all of the five lines, and an amount of 0.6 is usual. So of a blur by which both look
alike it is none."""

MOST_BLUR_PX = 0.8
"""Largest blur beside which sharpening is told: what a mask adds to a larger one looks like less of it, and images that
were enlarged seem to be sharpened."""

Indices = NDArray[np.int64]


class Sharpened(NamedTuple):
    """The optics that are assumed of an image, and the amount of an unsharp mask that was undone."""

    optics: Optics
    undone: float


SHARPENED = named_tuple(Sharpened, "optics f0", optics=OPTICS)


class Excess(NamedTuple):
    """What an image shows beside the optics that were assumed, each with the other: variance of its blur in px^2, and
    amount of sharpening. NaN where unknown.
    """

    blur_px2: float
    sharpening: float


UNKNOWN = Excess(math.nan, math.nan)


@compiled("u3 lines i1 f2 f1 sharpened", inner=True, lines=SEARCH_LINES, sharpened=SHARPENED)
def excess_sharpening(
    image: Image, at: SearchLines, rows: Indices, appearance: Array, distance: Array, sharpened: Sharpened
) -> Excess:
    """What an image shows of an unsharp mask and of its blur beside the optics.

    Arguments as of `excess_blur`. UNKNOWN where too few points were measured. The blur may be off because of what is
    not yet known of the mask: the second fit is with the one that the first finds. Beside a large one none is shown.
    """
    optics = sharpened.optics
    first, square = excess_of_points(image, at, rows, appearance, distance, sharpened), optics.blur_px**2
    if math.isnan(first.blur_px2):
        return UNKNOWN
    blur_px = math.sqrt(max(square + max(first.blur_px2, -square / 2), PIXEL_PX**2))
    if blur_px > MOST_BLUR_PX:
        return Excess(first.blur_px2, -sharpened.undone / (1.0 + sharpened.undone))
    again = Sharpened(Optics(optics.light, blur_px, optics.colours), sharpened.undone)
    second = excess_of_points(image, at, rows, appearance, distance, again)
    return Excess(second.blur_px2 + blur_px**2 - square, second.sharpening)


@compiled("u3 lines i1 f2 f1 sharpened", inner=True, lines=SEARCH_LINES, sharpened=SHARPENED)
def excess_of_points(
    image: Image, at: SearchLines, rows: Indices, appearance: Array, distance: Array, sharpened: Sharpened
) -> Excess:
    """Medians over control points of edges that stand alone of what each shows beside the optics, to first order."""
    optics, lines = sharpened.optics, at.lines
    blur_px2, amount, known = np.empty(len(rows)), np.empty(len(rows)), 0
    colour, edges, sums = np.empty(3), np.empty((COMPONENTS, 4)), room_for(COMPONENTS, 0, ALONG_PX)
    moved = np.array([0.0, -optics.blur_px, optics.blur_px, -REACH_PX, REACH_PX])
    strip, measures = Strip(ALONG_PX, ALONG_PX, without_derivatives(optics)), measured_points(distance)
    for p in range(len(rows)):
        if not measures[p]:
            continue
        height = learned_light(appearance[rows[p]], image.shape[2], optics, colour)
        if not height > optics.light[0, 1]:  # more than one code
            continue
        for k in range(COMPONENTS):
            edges[k, NORMAL_U], edges[k, NORMAL_V] = lines[p, NORMAL_U], lines[p, NORMAL_V]
            edges[k, U] = lines[p, U] + (distance[p] + moved[k]) * lines[p, NORMAL_U]
            edges[k, V] = lines[p, V] + (distance[p] + moved[k]) * lines[p, NORMAL_V]
        n = sums_of_steps(image, edges, 0.0, strip, colour, False, sums)
        if n == 0 or sums.products[2 * COMPONENTS + 1, 2 * COMPONENTS + 1] < n:
            continue
        found = excess_of(sums.products, n, height, sharpened)
        if not math.isnan(found.sharpening):
            blur_px2[known], amount[known] = found.blur_px2, found.sharpening
            known += 1
    if known < LEAST_MEASURED:
        return UNKNOWN
    return Excess(float(np.median(blur_px2[:known])), float(np.median(amount[:known])))


@compiled
def excess_of(products: Array, n: int, height: float, sharpened: Sharpened) -> Excess:
    """What the products of COMPONENTS steps over n pixels show; UNKNOWN where the step is less than half of its height.

    The prior is that of no sharpening at all: of what was undone, too.
    """
    light, terms = 2 * COMPONENTS, len(TERMS)
    A, x = np.zeros((terms, terms)), np.zeros(terms)
    for i in range(light):  # the level is eliminated
        for j in range(i + 1):
            products[i, j] -= products[light + 1, i] * products[light + 1, j] / n
            products[j, i] = products[i, j]
        products[light, i] -= products[light + 1, light] * products[light + 1, i] / n
    for k in range(terms):
        for i in range(light):
            if TERMS[k, i] == 0.0:
                continue
            x[k] += TERMS[k, i] * products[light, i]
            for m in range(k + 1):
                for j in range(light):
                    A[k, m] += TERMS[k, i] * TERMS[m, j] * products[i, j]
    prior = UNLIKELY_AMOUNT * height * height
    A[2, 2] += UNLIKELY
    A[3, 3] += prior
    x[3] += prior * height * sharpened.undone / (1.0 + sharpened.undone)
    if not (solve(A, x) >= 0.0 and x[0] > 0.5 * height):
        return UNKNOWN
    return Excess(sharpened.optics.blur_px**2 * x[2] / x[0], -x[3] / x[0])
