"""Compiled sub-pixel refinement of the control points, each with the edges that crowd about it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import WeightConfig
from uavbench.tracker.robust.edges.columns import MEAN_SQUARE, OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import CONTROL_POINTS, SEARCH_LINES, ControlPoints, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.crowd_kernels import (
    LEAST_ALONG_PX,
    Crowd,
    Extents,
    crowd,
    edges_near,
    extents_of_edges,
)
from uavbench.tracker.robust.edges.steps.optics_kernels import (
    OPTICS,
    Optics,
    displaced_px,
    learned_light,
    without_derivatives,
)
from uavbench.tracker.robust.edges.steps.step_kernels import CLEAR_WIDTHS, MAX_SHIFT_PX, MOST_STEPS, NO_STEP, fit_step
from uavbench.tracker.robust.edges.steps.strip_kernels import MeanLines, fit_strip, room_for_lines
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, REACH_PX, Strip, Sums, room_for
from uavbench.tracker.robust.edges.weight_kernels import WEIGHTS
from uavbench.tracker.robust.view import VIEW, View, pixel_of
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
MOST_ALONG_PX = 12
"""Most pixels of an edge to either side of a control point that belong to it: farther away a curved or occluded edge is
another one."""
COARSE_LINES, FINE_LINES = 1, 4
"""Scan lines to either side of a control point, of a first fit and of one at its step: each is linear in the shift."""
LINEAR_PX = 0.1
"""Shift up to which a fit is linear in it: that of a step blurred by 0.5 px is off by less than 0.001 px then."""
TINY = 1e-300
"""Least divisor, px^2."""


class FittedPoints(NamedTuple):
    """Control points after a fit: signed residual (n,) in px, weight (n,) in it, variance_px2 (n,) before it.

    at: the view that it found.
    """

    residual: Array
    weight: Array
    variance_px2: Array
    at: View


class SubpixelEdges(NamedTuple):
    """Distance (n, 1) of each control point's edge from its search line's middle, px, and its variance_px2 (n,).

    steps (n,): number of steps fitted together, 0 where none was. by_response (n, r): derivatives of the distance for
    the numbers of the response, 0 without a step. points (n, 3), lines (n, 4): what moves as the distance does, the
    control points, or where steps are fitted together a point between those of their edges.
    """

    distance: Array
    variance_px2: Array
    steps: Indices
    by_response: Array
    points: Array
    lines: Array


class Seen(NamedTuple):
    """Control points with their search lines, as fitted, and where their edges lie."""

    at: SearchLines
    points: ControlPoints
    fitted: FittedPoints
    extents: Extents


class Looks(NamedTuple):
    """An image, the appearance of the edges, and the optics; alone: these without the derivatives of the light."""

    image: Image
    appearance: Array
    optics: Optics
    alone: Optics


class Room(NamedTuple):
    """Arrays that locating an edge writes, made once: crowd and colour of a point, those of a coarse and of a fine fit,
    and of one to all lines, and others (g,), rows of the edges that are near.
    """

    crowd: Crowd
    coarse: Sums
    fine: Sums
    mean: MeanLines
    colour: Array
    others: Indices


class Found(NamedTuple):
    """Edges located so far, the variance own_px2 (n,) of each fit and its misfit (n, ACROSS): see `add_variances`."""

    edges: SubpixelEdges
    own_px2: Array
    misfit: Array


FITTED_POINTS = named_tuple(FittedPoints, "f1! f1! f1! view", view=VIEW)


@compiled(
    "u3 lines points f2 fitted optics weights",
    inner=True,
    lines=SEARCH_LINES,
    points=CONTROL_POINTS,
    fitted=FITTED_POINTS,
    optics=OPTICS,
    weights=WEIGHTS,
)
def refine_subpixel(
    image: Image,
    at: SearchLines,
    points: ControlPoints,
    appearance: Array,
    fitted: FittedPoints,
    optics: Optics,
    config: WeightConfig,
) -> SubpixelEdges:
    """Sub-pixel refinement: position of a blurred step fitted to the pixels around each control point.

    The variance is that of the fit, see `add_variances`, and the part of the learned mean square that the edge's offset
    leaves. If no step can be fitted, distance and variance are those of `fitted`, with an infinite distance where the
    weight is 0.
    """
    lines, first, n, numbers = at.lines, points.first, len(at.lines), len(optics.light) - 1
    found = Found(
        SubpixelEdges(
            np.full((n, 1), np.inf),
            fitted.variance_px2.copy(),
            np.zeros(n, np.int64),
            np.zeros((n, numbers)),
            points.points.copy(),
            lines.copy(),
        ),
        np.zeros(n),
        np.zeros((n, ACROSS)),
    )
    seen = Seen(at, points, fitted, extents_of_edges(at, first))
    looks = Looks(image, appearance, optics, without_derivatives(optics))
    room = Room(
        Crowd(np.empty((MOST_STEPS, 4)), np.empty(MOST_STEPS, np.int64)),
        room_for(MOST_STEPS, 0, COARSE_LINES),
        room_for(MOST_STEPS, numbers, FINE_LINES),
        room_for_lines(),
        np.empty(3),
        np.empty(len(first) - 1, np.int64),
    )
    for g in range(len(first) - 1):
        locate_edge(looks, seen, g, 1.0 - config.shared_part, room, found)
    return found.edges


@inlined(allocates=False)
def locate_edge(looks: Looks, seen: Seen, g: int, own_part: float, room: Room, found: Found) -> None:
    """Locate the control points of an edge of a fit between the pixels, in place.

    own_part: part of the learned mean square of a point's distance that is its own, and not its edge's.
    """
    at, points, edges, optics = seen.at, seen.points, found.edges, looks.optics
    first, rows, weights, residual = points.first, points.rows, seen.fitted.weight, seen.fitted.residual
    half_px, colour, reach_px = seen.extents.half_px, room.colour, REACH_PX + CLEAR_WIDTHS * optics.blur_px
    others = room.others[: edges_near(seen.extents, g, reach_px, room.others)]
    start, total, numbers = 0.0, 0.0, len(optics.light) - 1
    for p in range(first[g], first[g + 1]):
        if weights[p] > 0.0:
            start, total = start + weights[p] * residual[p], total + weights[p]
    start /= max(total, 1e-12)
    along = min(MOST_ALONG_PX, max(LEAST_ALONG_PX, int(half_px[g]) - 1))
    coarse, fine = Strip(LEAST_ALONG_PX, COARSE_LINES, looks.alone), Strip(along, FINE_LINES, optics)
    for p in range(first[g], first[g + 1]):
        if not weights[p] > 0.0:
            continue
        edges.distance[p, 0] = residual[p]
        row = looks.appearance[rows[p]]
        if at.side[p] == OUTSIDE or not learned_light(row, looks.image.shape[2], optics, colour) > 0.0:
            continue
        steps = crowd(at, first, p, half_px, others, reach_px, room.crowd)
        if steps == 0:
            continue
        together = room.crowd.lines[:steps]
        step = NO_STEP
        if steps == 1 and numbers == 0:
            step = fit_strip(looks.image, together[0], start, fine, colour, room.mean, room.fine.misfit)
            if LINEAR_PX < abs(step.distance - start) < MAX_SHIFT_PX:
                at_step = step.distance
                step = fit_strip(looks.image, together[0], at_step, fine, colour, room.mean, room.fine.misfit)
        if not step.distance < np.inf:
            near = fit_step(looks.image, together, start, coarse, colour, room.coarse)
            if not abs(near.distance - start) < MAX_SHIFT_PX:
                continue
            step = fit_step(looks.image, together, near.distance, fine, colour, room.fine)
        if abs(step.distance - start) < MAX_SHIFT_PX:
            moved = displaced_px(row, looks.image, at.lines[p], optics, colour)
            edges.distance[p, 0], edges.steps[p] = step.distance - moved, steps
            edges.variance_px2[p] = own_part * row[MEAN_SQUARE]
            found.own_px2[p] = step.variance_px2
            for x in range(ACROSS):
                found.misfit[p, x] = room.fine.misfit[x]
            for r in range(edges.by_response.shape[1]):
                edges.by_response[p, r] = room.fine.by_response[r]
            if steps > 1:
                shares, of = room.fine.shares[:steps], room.crowd.points
                share_motion(points.points, of, shares, seen.fitted.at, edges.points[p], edges.lines[p])
    add_variances(edges.variance_px2, found.own_px2, found.misfit, edges.steps, first[g : g + 2])
    share_evenly(edges.by_response, edges.steps, first, g)


@inlined(allocates=False)
def add_variances(variance: Array, own_px2: Array, misfit: Array, steps: Indices, first: Indices) -> None:
    """Add to variances (n,) those of the fits of an edge's located points, steps (n,) > 0 from first[0] to first[1].

    own_px2 (n,): if the misfit of the light is noise of each pixel; misfit (n, ACROSS): that of `write_misfit`. Of
    noise its squares are expected to sum up to the own variances. What they are more lasts along the edge, as that of a
    line beside it: with the correlation r between a point and the next one, (1 + r) / (1 - r) points are as one (those
    of a process of first order: Bayley & Hammersley 1946), but not more than there are.
    """
    own, squares, beside, located, last = 0.0, 0.0, 0.0, 0, -1
    for p in range(first[0], first[1]):
        if steps[p] > 0:
            own, located = own + own_px2[p], located + 1
            for x in range(ACROSS):
                squares += misfit[p, x] * misfit[p, x]
                beside += misfit[p, x] * misfit[last, x] if last >= 0 else 0.0
            last = p
    excess, alike = max(0.0, squares - own), 1.0
    if located > 1:
        lasting = max(0.0, beside * located / (located - 1))
        alike = min(float(located), (excess + lasting) / max(TINY, excess - lasting))
    for p in range(first[0], first[1]):
        if steps[p] > 0:
            variance[p] += own_px2[p] * (1.0 + alike * excess / max(own, TINY))


@inlined(allocates=False)
def share_motion(points: Array, of: Indices, shares: Array, view: View, point: Array, line: Array) -> None:
    """Write the point (3,) that moves in the image as the mean by shares (k,) of k points, and its pixel into line.

    A pixel is linear in a point over its depth: the mean of several points over their depths is one between them over
    its own. So is its motion across the axis, and nearly so along it, as the points are within a few pixels. Shares
    below 0 count as 0: those are of heights that are hardly told apart.
    """
    R, t, depth, mean_x, mean_y, mean_z = view.R, view.t, 0.0, 0.0, 0.0, 0.0
    for k in range(len(shares)):
        x, y, z = points[of[k], 0], points[of[k], 1], points[of[k], 2]
        per_depth = max(0.0, shares[k]) / (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2])
        depth += per_depth
        mean_x, mean_y, mean_z = mean_x + per_depth * x, mean_y + per_depth * y, mean_z + per_depth * z
    if not depth > 0.0:
        return
    x, y, z = mean_x / depth, mean_y / depth, mean_z / depth
    point[0], point[1], point[2] = x, y, z
    line[U], line[V] = pixel_of(
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0],
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1],
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2],
        view,
    )


@inlined(allocates=False)
def share_evenly(by_response: Array, steps: Indices, first: Indices, group: int) -> None:
    """Give all points of an edge that are located (n,) > 0 the mean of their derivatives (n, r), in place.

    So the response is told by whole edges, whose offsets have a prior, and not by how a corner's light differs. Steps
    that a change of the response moves by more than the fit is linear are not told from those beside them.
    """
    for r in range(by_response.shape[1]):
        total, count = 0.0, 0
        for p in range(first[group], first[group + 1]):
            if steps[p] > 0 and abs(by_response[p, r]) < MAX_SHIFT_PX:
                total, count = total + by_response[p, r], count + 1
        for p in range(first[group], first[group + 1]):
            if steps[p] > 0:
                by_response[p, r] = total / max(count, 1)
