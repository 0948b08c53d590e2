"""Compiled neighbourhood: the other edges beside each control point, whose steps of light blur into its own."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.columns import NORMAL_U, NORMAL_V, OUTSIDE, U, V
from uavbench.tracker.robust.edges.measurements import CONTROL_POINTS, SEARCH_LINES, ControlPoints, SearchLines
from uavbench.tracker.robust.edges.weight_kernels import PARALLEL_COSINE
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

NEAREST = 3
"""Neighbours that are kept: one more than can be fitted together with an edge, to know that there are too many."""

Indices = NDArray[np.int64]


class Neighbours(NamedTuple):
    """Other edges beside each control point, the nearest ones.

    rows (n, k) of the control points that stand for them, -1 where there are fewer; across_px (n, k) where the normal
    of the point meets them.
    """

    rows: Indices
    across_px: Array


NEIGHBOURS = named_tuple(Neighbours, "i2! f2!")


@compiled("points lines f0", points=CONTROL_POINTS, lines=SEARCH_LINES)
def neighbouring_edges(points: ControlPoints, at: SearchLines, reach_px: float) -> Neighbours:
    """Nearly parallel edges that the normal of each control point meets within reach_px."""
    lines, side, half, first = at.lines, at.side, points.half_px, points.first
    n, edges = len(lines), len(first) - 1
    rows, across = np.full((n, NEAREST), -1, np.int64), np.full((n, NEAREST), np.inf)
    box = np.empty((edges, 4))  # smallest u, v and largest of each edge in view
    for g in range(edges):
        box[g, 0] = box[g, 1] = np.inf
        box[g, 2] = box[g, 3] = -np.inf
        for q in range(first[g], first[g + 1]):
            if side[q] != OUTSIDE:
                wide = half[q] + reach_px
                box[g, 0], box[g, 1] = min(box[g, 0], lines[q, U] - wide), min(box[g, 1], lines[q, V] - wide)
                box[g, 2], box[g, 3] = max(box[g, 2], lines[q, U] + wide), max(box[g, 3], lines[q, V] + wide)
    for g in range(edges):
        for p in range(first[g], first[g + 1]):
            if side[p] == OUTSIDE:
                continue
            u, v = lines[p, U], lines[p, V]
            for other in range(edges):
                inside = box[other, 0] < u < box[other, 2] and box[other, 1] < v < box[other, 3]
                if other != g and inside:
                    q, meets = nearest_piece(lines, side, half, p, first[other], first[other + 1])
                    if abs(meets) <= reach_px:
                        insert(rows[p], across[p], q, meets)
    return Neighbours(rows, across)


@compiled("f2 i1 f1 i0 i0 i0", inner=True)
def nearest_piece(lines: Array, side: Indices, half: Array, p: int, start: int, stop: int) -> tuple[int, float]:
    """The row from start to stop whose piece of an edge the normal of row p meets first, and how far off, px.

    The distance is inf where there is none.
    """
    nu, nv = lines[p, NORMAL_U], lines[p, NORMAL_V]
    best, nearest = -1, np.inf
    for q in range(start, stop):
        mu, mv = lines[q, NORMAL_U], lines[q, NORMAL_V]
        cosine = nu * mu + nv * mv
        if side[q] == OUTSIDE or abs(cosine) < PARALLEL_COSINE:
            continue
        du, dv = lines[q, U] - lines[p, U], lines[q, V] - lines[p, V]
        across = (du * mu + dv * mv) / cosine
        along = abs((dv - across * nv) * mu - (du - across * nu) * mv)
        if along <= half[q] and abs(across) < abs(nearest):
            best, nearest = q, across
    return best, nearest


@compiled("i1! f1! i0 f0", inner=True)
def insert(rows: Indices, across: Array, row: int, distance: float) -> None:
    """Put a row and its distance in order among the nearest ones (k,), in place; the farthest one drops out."""
    for k in range(len(rows)):
        if abs(distance) < abs(across[k]):
            rows[k], row = row, rows[k]
            across[k], distance = distance, across[k]
