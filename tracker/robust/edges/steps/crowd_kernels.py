"""Compiled search for the edges that crowd about a control point: they show in the same pixels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import SEARCH_LINES, SearchLines
from uavbench.tracker.robust.edges.steps.step_kernels import MOST_STEPS
from uavbench.tracker.robust.edges.weight_kernels import PARALLEL_COSINE, half_spacing
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]
LEAST_ALONG_PX = 2
"""Pixels of an edge that belong to each of its control points at least: those of points 6 px apart do not overlap."""
SAME_PX = 0.3
"""Distance across below which two edges are one step."""
BENT_PX = 8.0
"""Most that the lens bends an edge: those farther from the line of their first point are not looked at."""


class Crowd(NamedTuple):
    """Edges that lie together: lines (k, 4), pixel and normal on the side of the first; points (k,), one of each."""

    lines: Array
    points: Indices


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
