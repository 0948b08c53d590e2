"""Compiled measurement of the blur of an image, by the steps of edges that stand alone.

The light about such an edge is fitted by three steps, one width of the assumed blur apart. Together they are one step
of another blur: as of the components of a mixture, its variance is that of each and that of their places.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, U, V
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.optics_kernels import OPTICS, Optics, learned_light, without_derivatives
from uavbench.tracker.robust.edges.steps.step_kernels import solve
from uavbench.tracker.robust.edges.steps.sum_kernels import Strip, room_for, sums_of_steps
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

COMPONENTS = 3
"""Steps fitted to an edge."""
ALONG_PX = 2
"""Scan lines to either side of a control point."""
LEAST_MEASURED, MOST_MEASURED = 5, 24
"""Control points at which the blur is measured: the median of fewer is not that of the image; more, spread over all,
take time."""

Indices = NDArray[np.int64]


@compiled
def measured_points(distance: Array) -> NDArray[np.bool_]:
    """Which control points (n,) are measured: of those that stand alone, whose distance is not inf, some of many."""
    out, alone = np.zeros(len(distance), np.bool_), 0
    for p in range(len(distance)):
        alone += int(distance[p] < np.inf)
    every, alone = 1 + alone // MOST_MEASURED, 0
    for p in range(len(distance)):
        alone += int(distance[p] < np.inf)
        out[p] = distance[p] < np.inf and alone % every == 0
    return out


@compiled("u3 lines i1 f2 f1 optics", inner=True, lines=SEARCH_LINES, optics=OPTICS)
def excess_blur(
    image: Image, at: SearchLines, rows: Indices, appearance: Array, distance: Array, optics: Optics
) -> float:
    """Variance of the blur in px^2 beyond that of the optics: the median over control points of edges that stand alone.

    rows (n,) of appearance; distance (n,) in px of a step from the point along its normal, inf where none is alone. NaN
    where too few were measured.
    """
    blur_px = optics.blur_px
    lines, measured, known, size = at.lines, np.empty(len(rows)), 0, 2 * COMPONENTS + 2
    colour, edges, sums = np.empty(3), np.empty((COMPONENTS, 4)), room_for(COMPONENTS, 0, ALONG_PX)
    A, x, products = sums.A, sums.x[:COMPONENTS], sums.products
    strip, measures = Strip(ALONG_PX, ALONG_PX, without_derivatives(optics)), measured_points(distance)
    for p in range(len(rows)):
        if not measures[p] or not learned_light(appearance[rows[p]], image.shape[2], optics, colour) > 0.0:
            continue
        for k in range(COMPONENTS):
            moved = distance[p] + (k - 1) * blur_px
            edges[k, NORMAL_U], edges[k, NORMAL_V] = lines[p, NORMAL_U], lines[p, NORMAL_V]
            edges[k, U] = lines[p, U] + moved * lines[p, NORMAL_U]
            edges[k, V] = lines[p, V] + moved * lines[p, NORMAL_V]
        n = sums_of_steps(image, edges, 0.0, strip, colour, False, sums)
        seen = products[size - 1, size - 1]
        if n == 0 or seen < n:
            continue
        for i in range(COMPONENTS):  # the level is eliminated
            x[i] = products[size - 2, 2 * i] - products[size - 1, size - 2] * products[size - 1, 2 * i] / n
            for j in range(i + 1):
                A[i, j] = products[2 * i, 2 * j] - products[size - 1, 2 * i] * products[size - 1, 2 * j] / n
                A[j, i] = A[i, j]
        height = x[0] + x[1] + x[2] if solve(A, x) >= 0.0 else 0.0
        if height > optics.light[0, 1]:  # more than one code
            mean = blur_px * (x[2] - x[0]) / height
            measured[known] = blur_px**2 * (x[2] + x[0]) / height - mean**2
            known += 1
    return float(np.median(measured[:known])) if known >= LEAST_MEASURED else math.nan
