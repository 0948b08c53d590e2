"""Compiled sub-pixel refinement of the control points, each with the edges that crowd about it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.config.edges import WeightConfig
from uavbench.tracker.robust.edges.columns import MEAN_SQUARE, NORMAL_U, NORMAL_V, OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import CONTROL_POINTS, SEARCH_LINES, ControlPoints, SearchLines
from uavbench.tracker.robust.edges.profile_kernels import Image
from uavbench.tracker.robust.edges.steps.optics_kernels import OPTICS, Optics, learned_light
from uavbench.tracker.robust.edges.steps.step_kernels import CLEAR_WIDTHS, MAX_SHIFT_PX, MOST_STEPS, fit_step
from uavbench.tracker.robust.edges.steps.sum_kernels import ACROSS, REACH_PX, Strip, room_for
from uavbench.tracker.robust.edges.weight_kernels import PARALLEL_COSINE, WEIGHTS, half_spacing
from uavbench.tracker.robust.view import VIEW, View, pixel_of
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LEAST_ALONG_PX, MOST_ALONG_PX = 2, 12
"""Pixels of an edge to either side of a control point that belong to it: those of points 6 px apart do not overlap;
farther away a curved or occluded edge is another one."""
SAME_PX = 0.3
"""Distance across below which two edges are one step."""
COARSE_LINES, FINE_LINES = 1, 4
"""Scan lines to either side of a control point, of a first fit and of one at its step: each is linear in the shift."""
TINY = 1e-300
"""Least divisor, px^2."""
BENT_PX = 8.0
"""Most that the lens bends an edge: those farther from the line of their first point are not looked at."""


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


class Crowd(NamedTuple):
    """Edges that lie together: lines (k, 4), pixel and normal on the side of the first; points (k,), one of each."""

    lines: Array
    points: Indices


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
    lines, side, rows, first = at.lines, at.side, points.rows, points.first
    residual, weights = fitted.residual, fitted.weight
    distance, variance = np.empty((len(lines), 1)), fitted.variance_px2.copy()
    together = np.zeros(len(lines), np.int64)
    distance[:] = np.inf
    own_px2, misfit = np.zeros(len(lines)), np.zeros((len(lines), ACROSS))
    numbers = len(optics.light) - 1
    by_response, alone = np.zeros((len(lines), numbers)), Optics(optics.light[:1], optics.blur_px)
    coarse, reach_px = Strip(LEAST_ALONG_PX, COARSE_LINES, alone), REACH_PX + CLEAR_WIDTHS * optics.blur_px
    colour, sums = np.empty(3), room_for(MOST_STEPS, numbers, FINE_LINES)
    moved, moved_lines = points.points.copy(), lines.copy()
    crowded = Crowd(np.empty((MOST_STEPS, 4)), np.empty(MOST_STEPS, np.int64))
    of_light = room_for(MOST_STEPS, 0, COARSE_LINES)
    extents, others = extents_of_edges(at, first), np.empty(len(first) - 1, np.int64)
    for g in range(len(first) - 1):
        crowding = others[: edges_near(extents, g, reach_px, others)]
        start, total = 0.0, 0.0
        for p in range(first[g], first[g + 1]):
            if weights[p] > 0.0:
                start, total = start + weights[p] * residual[p], total + weights[p]
        start /= max(total, 1e-12)
        along = min(MOST_ALONG_PX, max(LEAST_ALONG_PX, int(extents.half_px[g]) - 1))
        for p in range(first[g], first[g + 1]):
            if not weights[p] > 0.0:
                continue
            distance[p, 0] = residual[p]
            if side[p] == OUTSIDE or not learned_light(appearance[rows[p]], image.shape[2], optics.light, colour) > 0.0:
                continue
            steps = crowd(at, first, p, extents.half_px, crowding, reach_px, crowded)
            if steps == 0:
                continue
            edges = crowded.lines[:steps]
            near = fit_step(image, edges, start, coarse, colour, of_light)
            if not abs(near.distance - start) < MAX_SHIFT_PX:
                continue
            found = fit_step(image, edges, near.distance, Strip(along, FINE_LINES, optics), colour, sums)
            if abs(found.distance - start) < MAX_SHIFT_PX:
                distance[p, 0], together[p] = found.distance, steps
                variance[p] = (1.0 - config.shared_part) * appearance[rows[p], MEAN_SQUARE]
                own_px2[p], misfit[p] = found.variance_px2, sums.misfit
                by_response[p] = sums.by_response
                if steps > 1:
                    shares = sums.shares[:steps]
                    share_motion(points.points, crowded.points, shares, fitted.at, moved[p], moved_lines[p])
        add_variances(variance, own_px2, misfit, together, first[g : g + 2])
        share_evenly(by_response, together, first, g)
    return SubpixelEdges(distance, variance, together, by_response, moved, moved_lines)


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


@inlined
def share_motion(points: Array, of: Indices, shares: Array, view: View, point: Array, line: Array) -> None:
    """Write the point (3,) that moves in the image as the mean by shares (k,) of k points, and its pixel into line.

    A pixel is linear in a point over its depth: the mean of several points over their depths is one between them over
    its own. So is its motion across the axis, and nearly so along it, as the points are within a few pixels. Shares
    below 0 count as 0: those are of heights that are hardly told apart.
    """
    R, t, depth = view.R, view.t, 0.0
    mean = np.zeros(3)
    for k in range(len(shares)):
        x, y, z = points[of[k], 0], points[of[k], 1], points[of[k], 2]
        per_depth = max(0.0, shares[k]) / (R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2])
        depth += per_depth
        mean[0], mean[1], mean[2] = mean[0] + per_depth * x, mean[1] + per_depth * y, mean[2] + per_depth * z
    if not depth > 0.0:
        return
    x, y, z = mean[0] / depth, mean[1] / depth, mean[2] / depth
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


class Extents(NamedTuple):
    """Where edges lie: box (g, 4) of their points within the image, least u and v, then the largest ones, px.

    half_px (g,): see `half_spacing`.
    """

    box: Array
    half_px: Array


@compiled("lines i1", inner=True, lines=SEARCH_LINES)
def extents_of_edges(at: SearchLines, first: Indices) -> Extents:
    """Extents of the edges in view; a box without points is empty."""
    lines, side, edges = at.lines, at.side, len(first) - 1
    box, half_px = np.empty((edges, 4)), np.empty(edges)
    for g in range(edges):
        half_px[g] = half_spacing(lines, first, g)
        low_u, low_v, high_u, high_v = np.inf, np.inf, -np.inf, -np.inf
        for p in range(first[g], first[g + 1]):
            if side[p] != OUTSIDE:
                low_u, low_v = min(low_u, lines[p, U]), min(low_v, lines[p, V])
                high_u, high_v = max(high_u, lines[p, U]), max(high_v, lines[p, V])
        box[g, 0], box[g, 1], box[g, 2], box[g, 3] = low_u, low_v, high_u, high_v
    return Extents(box, half_px)


@inlined(allocates=False)
def edges_near(extents: Extents, group: int, reach_px: float, others: Indices) -> int:
    """Number of the edges that `crowd` may find about a point of this one; they are written into others (g,).

    Only saves time: those left out are farther away than an edge of a crowd may be.
    """
    box, count = extents.box, 0
    low_u, low_v, high_u, high_v = box[group, 0], box[group, 1], box[group, 2], box[group, 3]
    for g in range(len(box)):
        far_px = reach_px + max(LEAST_ALONG_PX, extents.half_px[g]) + 2.0  # 1 px more than a crowd reaches
        apart_u, apart_v = max(box[g, 0] - high_u, low_u - box[g, 2]), max(box[g, 1] - high_v, low_v - box[g, 3])
        if g != group and apart_u <= far_px and apart_v <= far_px:
            others[count] = g
            count += 1
    return count


@inlined(allocates=False)
def crowd(
    at: SearchLines, first: Indices, p: int, half_px: Array, others: Indices, reach_px: float, into: Crowd
) -> int:
    """Number of the edges that the pixels around a control point show, its own first; 0 if there are too many.

    others: edges that are near, half_px (g,): see `Extents`. Their lines, pixel and normal on the side of the point's
    own, and a point of each are written into `into`. An edge is represented by its control point nearest to p, and ends
    half a spacing from its last one.
    """
    lines, side, edges, count = at.lines, at.side, into.lines, 1
    into.points[0] = p
    u, v, nu, nv = lines[p, U], lines[p, V], lines[p, NORMAL_U], lines[p, NORMAL_V]
    edges[0, U], edges[0, V], edges[0, NORMAL_U], edges[0, NORMAL_V] = u, v, nu, nv
    for g in others:
        q = first[g]
        across = (lines[q, U] - u) * lines[q, NORMAL_U] + (lines[q, V] - v) * lines[q, NORMAL_V]
        if abs(across) > BENT_PX + reach_px:
            continue
        nearest, least = -1, np.inf
        for q in range(first[g], first[g + 1]):
            du, dv = lines[q, U] - u, lines[q, V] - v
            if side[q] != OUTSIDE and du * du + dv * dv < least:
                nearest, least = q, du * du + dv * dv
        if nearest < 0:
            continue
        mu, mv = lines[nearest, NORMAL_U], lines[nearest, NORMAL_V]
        cosine = nu * mu + nv * mv
        du, dv = lines[nearest, U] - u, lines[nearest, V] - v
        if abs(cosine) < PARALLEL_COSINE or abs(du * mu + dv * mv) > reach_px:
            continue
        if abs(dv * mu - du * mv) > max(LEAST_ALONG_PX, half_px[g]) + 1.0:
            continue
        seen = False
        for k in range(count):
            seen |= abs((lines[nearest, U] - edges[k, U]) * mu + (lines[nearest, V] - edges[k, V]) * mv) < SAME_PX
        if seen:
            continue
        if count == MOST_STEPS:
            return 0
        sign = 1.0 if cosine > 0.0 else -1.0
        edges[count, U], edges[count, V] = lines[nearest, U], lines[nearest, V]
        edges[count, NORMAL_U], edges[count, NORMAL_V] = sign * mu, sign * mv
        into.points[count] = nearest
        count += 1
    return count
