"""Compiled measurement of where the colours of an image lie beside each other, by the steps of edges that stand alone.

A lens displaces red and blue against green, outwards by more the farther from its axis (lateral colour). A sensor
whose pixels see one colour each displaces all, red and blue by more, by how an edge lies between these pixels. Each
colour has a step of its own at an edge.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import BINS, NORMAL_U, NORMAL_V
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.blur_kernels import ALONG_PX, LEAST_MEASURED, measured_points
from uavbench.tracker.robust.edges.steps.optics_kernels import (
    COLOURS,
    OPTICS,
    OUTWARDS,
    Optics,
    channel_px,
    displaced_px,
    learned_light,
    light_step,
    outwards,
    without_derivatives,
)
from uavbench.tracker.robust.edges.steps.step_kernels import fit_step
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, Strip, room_for
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

BLUE, GREEN, RED = 0, 1, 2
"""Channels of an image."""
PAIRS = np.array([[BLUE, GREEN], [RED, GREEN], [BLUE, RED]])
"""Channels whose distances are compared."""
MEDIAN_SQUARE = 0.4549
"""Median of the square of a normal variable of variance 1."""
OUTLIER = 3.0
"""Differences beyond so many deviations are not of the same step."""

PIXELS = (2 * ALONG_PX + 1) * ACROSS
"""Pixels about a point."""
TINY_PX2 = 1e-12
"""Least variance of a difference or a fit, px^2: that of an image without noise."""

Indices = NDArray[np.int64]


class SeenColours(NamedTuple):
    """What a frame says of its colours: information (2, 3, 3) and vector (2, 3), px^-2 and px^-1, on the displacements
    of blue and of red against green: outwards, along u and along v. apart_px2 (3,): variance of the difference between
    each of PAIRS less that of the displacements known before; of_fits_px2 (3,): of the fits to each channel. points:
    at how many, 0 where too few were measured.
    """

    information: Array
    vector: Array
    apart_px2: Array
    of_fits_px2: Array
    points: int


@compiled("u3 lines i1 f2 f1 optics", inner=True, lines=SEARCH_LINES, optics=OPTICS)
def colours_apart(
    image: Image, at: SearchLines, rows: Indices, appearance: Array, distance: Array, optics: Optics
) -> SeenColours:
    """What the steps of edges that stand alone say of the colours of an image (h, w, 3). Arguments as of `excess_blur`.

    Relative to the optics: a difference that is far from those that they give is an outlier. Nothing is said where a
    pixel is blown out, since steps are displaced beside it.
    """
    lines, n, known = at.lines, len(rows), 0
    located, own, factors = np.empty((n, COLOURS)), np.empty((n, COLOURS)), np.empty((n, COLOURS))
    colour, edge, sums, edges, last = np.empty(COLOURS), np.empty((1, 4)), room_for(1, 0, ALONG_PX), 0, -1
    strip, measures = Strip(ALONG_PX, ALONG_PX, without_derivatives(optics)), measured_points(distance)
    for p in range(n if image.shape[2] == COLOURS else 0):
        if not measures[p]:
            continue
        edge[0, :] = lines[p, :]
        row, all_seen, of_image = appearance[rows[p]], True, outwards(image, edge[0])
        learned_light(row, COLOURS, optics, colour)
        start = distance[p] - displaced_px(row, image, edge[0], optics, colour)
        for c in range(COLOURS):
            colour[:] = 0.0
            colour[c] = math.copysign(1.0, light_step(row, c, optics.light))
            near = start + channel_px(c, of_image, edge[0], optics)
            step = fit_step(image, edge, near, strip, colour, sums)
            located[known, c], own[known, c] = step.distance, step.variance_px2
            all_seen = all_seen and step.distance < np.inf and sums.products[3, 3] == PIXELS
        if all_seen:
            edges, last = edges + int(rows[p] // BINS != last), rows[p] // BINS
            factors[known, 0] = of_image
            factors[known, 1], factors[known, 2] = edge[0, NORMAL_U], edge[0, NORMAL_V]
            known += 1
    return seen_of(located[:known], own[:known], factors[:known], optics.colours, edges)


@compiled("", inner=True)
def nothing_seen() -> SeenColours:
    """What is said where nothing is asked."""
    return SeenColours(np.zeros((2, 3, 3)), np.zeros((2, 3)), np.zeros(3), np.zeros(COLOURS), 0)


@compiled
def seen_of(located: Array, own: Array, factors: Array, colours: Array, edges: int) -> SeenColours:
    """What distances located (n, 3) in the channels, with variances own (n, 3), say of displacements that move them by
    these factors (n, 3).

    colours (3, 4): what is known of the channels before. Points of an edge differ alike: they count as one.
    """
    n, seen = len(located), nothing_seen()
    if n < LEAST_MEASURED:
        return seen
    part = edges / n
    for k in range(len(PAIRS)):
        first, second = PAIRS[k, 0], PAIRS[k, 1]
        difference, left = located[:, first] - located[:, second], np.empty(n)
        for p in range(n):
            left[p] = difference[p]
            for i in range(3):
                left[p] -= factors[p, i] * (colours[first, OUTWARDS + i] - colours[second, OUTWARDS + i])
        square = max(TINY_PX2, float(np.median(left * left)) / MEDIAN_SQUARE)
        seen.apart_px2[k] = square
        for p in range(n if k < 2 else 0):
            if not left[p] * left[p] < OUTLIER * OUTLIER * square:
                continue
            for i in range(3):
                seen.vector[k, i] += factors[p, i] * difference[p] * part / square
                for j in range(3):
                    seen.information[k, i, j] += factors[p, i] * factors[p, j] * part / square
    for c in range(COLOURS):
        seen.of_fits_px2[c] = np.median(own[:, c])
    return SeenColours(seen.information, seen.vector, seen.apart_px2, seen.of_fits_px2, n)
