"""Compiled sampling of control points on the visible edges with hidden-line removal, and projection at another pose."""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import Point, camera_centre, normal_row
from uavbench.tracker.robust.edges.beside.contact_kernels import PARTS
from uavbench.tracker.robust.edges.columns import (
    BESIDE,
    BINS,
    BOTH_FACES,
    CREASE,
    EDGE,
    FACES,
    NORMAL_U,
    NORMAL_V,
    OUTSIDE,
    PART,
    SILHOUETTE_NEGATIVE,
    SILHOUETTE_POSITIVE,
    U,
    V,
)
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.edges.hidden_line_kernels import NONE, occluder, sight_from
from uavbench.tracker.robust.edges.measurements import CONTROL_POINTS, ControlPoints, SearchLines
from uavbench.tracker.robust.edges.visible_kernels import visible_parts
from uavbench.tracker.robust.view import VIEW, View, is_clear, pixel_of
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.lens import project
from uavbench.trajectories.pose import Array

MARGIN_PX = float(BESIDE)
"""Least distance of control points from the image border, px: the colours beside them must be inside."""
LEAST_VISIBLE = 0.1
"""Least share of the points that is assumed visible, in case hardly any is."""
FIRST_PART = 0.5
"""Part of the points by which the visible share is estimated, before all are placed."""
LEAST_LENGTH_PX, MOST_LENGTH_PX, BISECTIONS = 0.01, 16384.0, 12
"""Lengths of edges in an image, and halvings of their ratio, to less than a hundredth."""

Indices = NDArray[np.int64]


@compiled("f2! i2!", inner=True)
def by_edge(points: Array, keys: Indices) -> ControlPoints:
    """Control points with their rows of appearance, and the first row of each edge."""
    n = len(keys)
    rows, first = np.empty(n, np.int64), np.empty(n + 1, np.int64)
    e = 0
    for p in range(n):
        rows[p] = (keys[p, EDGE] * 3 + keys[p, FACES] - 1) * BINS + keys[p, PART]
        if p == 0 or keys[p, EDGE] != keys[p - 1, EDGE]:
            first[e] = p
            e += 1
    first[e] = n
    return ControlPoints(points, keys, rows, first[: e + 1].copy())


@compiled("f0 f0 f0", inner=True, allocates=False)
def points_on(length_px: float, spacing_px: float, dense_px: float) -> float:
    """Number of points on an edge: one every spacing_px up to dense_px, from there on by the root of its length.

    All pixels of a long edge see about the same offset, while short ones see others, often across its direction.
    """
    return sampled_length(length_px, dense_px) / spacing_px


@compiled("f0 f0", inner=True, allocates=False)
def sampled_length(length_px: float, dense_px: float) -> float:
    """Length of an edge that gets points at the usual spacing."""
    return length_px if length_px <= dense_px else math.sqrt(dense_px * length_px)


@compiled("f1 f0 f0 f0 b0", inner=True, allocates=False)
def get_more_points(length: Array, spacing_px: float, dense_px: float, most: float, rounded: bool) -> bool:
    """Whether all edges get more than so many points; rounded: each gets a whole number of them."""
    total, whole = 0.0, 0
    if rounded:
        for e in range(len(length)):
            whole += int(points_on(length[e], spacing_px, dense_px) + 0.5)
        return float(whole) > most
    for e in range(len(length)):
        total += sampled_length(length[e], dense_px)
        if total > most * spacing_px:
            return True
    return False


@compiled("f1 f0 f0 b0", inner=True)
def dense_length(length: Array, spacing_px: float, wanted: float, rounded: bool) -> float:
    """Length in px up to which edges are sampled densely so that all get `wanted` points; MOST_LENGTH_PX for all.

    rounded: as of `get_more_points`.
    """
    if not get_more_points(length, spacing_px, MOST_LENGTH_PX, wanted, rounded):
        return MOST_LENGTH_PX
    low, high = LEAST_LENGTH_PX, MOST_LENGTH_PX
    for _ in range(1, BISECTIONS):
        middle = math.sqrt(low * high)
        if get_more_points(length, spacing_px, middle, wanted, rounded):
            high = middle
        else:
            low = middle
    return high


@compiled("edges view f0 i0", edges=EDGE_MAP, view=VIEW)
def sample_edges(edges: EdgeMap, view: View, spacing_px: float, most: int) -> ControlPoints:
    """Control points on the visible edges, hidden ones removed.

    Their spacing in the image is about spacing_px, larger if that would give many more than `most`.
    """
    ends, faces, in_front, size, R, t, lens = (
        edges.ends,
        edges.faces,
        edges.in_front,
        view.size_px,
        view.R,
        view.t,
        view.lens,
    )
    sight, triangles, rounded = sight_from(camera_centre(R, t)), edges.triangles, edges.rounded
    seen = visible_parts(edges, view)
    visible, part, depth, length = seen.faces, seen.part, seen.depth, seen.length_px
    points = np.empty((2 * most, 3))
    keys = np.empty((2 * most, 3), np.int64)
    n = 0
    all_fit = not get_more_points(length, spacing_px, MOST_LENGTH_PX, float(most), True)
    wanted = float(most) if all_fit else FIRST_PART * most
    for sampling in range(1 if all_fit else 0, 2):
        dense_px = dense_length(length, spacing_px, wanted, sampling > 0)
        n, left_over = 0, 0.5
        for i in range(len(length)):
            e, share = seen.edges[i], points_on(length[i], spacing_px, dense_px)
            count = int(share + 0.5)
            if sampling == 0 or (count == 0 and rounded[e]):  # the short edges of a round outline share their points
                left_over += share
                count = int(left_over)
                left_over -= count
            for k in range(count):
                s = (k + 0.5) / count
                near, far = s / depth[i, 1], (1.0 - s) / depth[i, 0]
                s = part[i, 0] + (part[i, 1] - part[i, 0]) * near / (near + far)
                q = Point(
                    ends[e, 0, 0] + s * (ends[e, 1, 0] - ends[e, 0, 0]),
                    ends[e, 0, 1] + s * (ends[e, 1, 1] - ends[e, 0, 1]),
                    ends[e, 0, 2] + s * (ends[e, 1, 2] - ends[e, 0, 2]),
                )
                u, v = project(
                    R[0, 0] * q.x + R[0, 1] * q.y + R[0, 2] * q.z + t[0],
                    R[1, 0] * q.x + R[1, 1] * q.y + R[1, 2] * q.z + t[1],
                    R[2, 0] * q.x + R[2, 1] * q.y + R[2, 2] * q.z + t[2],
                    lens,
                )
                if not (MARGIN_PX <= u <= size[0] - 1 - MARGIN_PX and MARGIN_PX <= v <= size[1] - 1 - MARGIN_PX):
                    continue
                if n == len(points) or not is_clear(u, v, view):
                    continue
                shown = edges.shown[e, visible[i] - 1, min(PARTS - 1, int(s * PARTS))]
                if shown == 0:
                    continue
                found = occluder(sight, q, triangles, faces[e, 0], faces[e, 1], in_front[e])
                if found != NONE:
                    in_front[e] = found
                    continue
                points[n, 0], points[n, 1], points[n, 2] = q.x, q.y, q.z
                keys[n, EDGE], keys[n, FACES], keys[n, PART] = e, shown, min(BINS - 1, int(s * BINS))
                n += 1
        wanted *= most / max(n, LEAST_VISIBLE * wanted)
    return by_edge(points[:n].copy(), keys[:n].copy())


@compiled("points f3! f3! view", inner=True, points=CONTROL_POINTS, view=VIEW)
def search_lines(points: ControlPoints, ends: Array, inward: Array, view: View) -> SearchLines:
    """Search lines of control points at a pose; marked as outside near the image's border and near masked pixels.

    ends, inward: those of all edges, see `EdgeMap`.
    """
    places, keys = points.points, points.keys
    n, R, t, lens, size, near = len(places), view.R, view.t, view.lens, view.size_px, view.near
    lines, J, side = np.zeros((n, 4)), np.zeros((n, 6)), np.empty(n, np.int64)
    c, d, w = np.empty(3), np.empty(3), np.empty(3)
    for k in range(n):
        e = keys[k, EDGE]
        length = 0.0
        for i in range(3):
            d[i] = ends[e, 1, i] - ends[e, 0, i]
            length += d[i] * d[i]
        h = 1e-3 / math.sqrt(length)
        for i in range(3):
            c[i] = R[i, 0] * places[k, 0] + R[i, 1] * places[k, 1] + R[i, 2] * places[k, 2] + t[i]
            w[i] = (R[i, 0] * d[0] + R[i, 1] * d[1] + R[i, 2] * d[2]) * h
        side[k] = OUTSIDE
        if c[2] <= near:
            continue
        u, v = pixel_of(c[0], c[1], c[2], view)
        if not (MARGIN_PX <= u <= size[0] - 1 - MARGIN_PX and MARGIN_PX <= v <= size[1] - 1 - MARGIN_PX):
            continue
        if not is_clear(u, v, view):
            continue
        step = c[2]  # a thousandth of the depth along the edge
        u1, v1 = pixel_of(c[0] + step * w[0], c[1] + step * w[1], c[2] + step * w[2], view)
        tu, tv = u1 - u, v1 - v
        norm = math.sqrt(tu * tu + tv * tv)
        if norm < 1e-6:
            continue
        nu, nv = -tv / norm, tu / norm
        lines[k, U], lines[k, V], lines[k, NORMAL_U], lines[k, NORMAL_V] = u, v, nu, nv
        normal_row(c[0], c[1], c[2], nu, nv, lens, J[k])
        side[k] = CREASE
        if keys[k, FACES] != BOTH_FACES:
            f = keys[k, FACES] - 1
            for i in range(3):
                w[i] = R[i, 0] * inward[e, f, 0] + R[i, 1] * inward[e, f, 1] + R[i, 2] * inward[e, f, 2]
            u1 = lens[0] * (w[0] - c[0] / c[2] * w[2])
            v1 = lens[1] * (w[1] - c[1] / c[2] * w[2])
            side[k] = SILHOUETTE_POSITIVE if u1 * nu + v1 * nv > 0 else SILHOUETTE_NEGATIVE
    return SearchLines(lines, J, side)
