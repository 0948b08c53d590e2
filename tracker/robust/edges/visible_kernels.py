"""Compiled search for the edges of visible faces within an image, without hidden-line removal."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import Point, camera_centre, clip_segment
from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.edges.groups import GROUP, GROUPS, Groups
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


BORDERS = 5
"""Planes that bound what an image shows: the least depth, and its four sides."""
ROUNDING = 1e-9
"""Part by which spheres are taken for larger, so that rounding excludes none."""
WORD = 8
"""Marks of edges that are looked at together."""


class VisibleParts(NamedTuple):
    """The parts within the image of the edges (n,) of visible faces there, in ascending order.

    faces (n,) bits of the visible faces beside each; part (n, 2) start and end of the part as fractions of the edge;
    depth (n, 2) at these; length_px (n,) projected length.
    """

    edges: Indices
    faces: Indices
    part: Array
    depth: Array
    length_px: Array


@inlined(allocates=False)
def in_camera(R: Array, t: Array, ends: Array, e: int, side: int) -> Point:
    """An end of an edge in the frame of the camera."""
    x, y, z = ends[e, side, 0], ends[e, side, 1], ends[e, side, 2]
    return Point(
        t[0] + R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        t[1] + R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        t[2] + R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@compiled("view", inner=True, view=VIEW)
def borders(view: View) -> Array:
    """Planes (BORDERS, 4) in the frame of a camera, n . p + d >= 0 within the image."""
    fx, fy, cx, cy = view.lens[0], view.lens[1], view.lens[2], view.lens[3]
    bounds = view.bounds_px
    return np.array(
        [
            [0.0, 0.0, 1.0, -view.near],
            [fx, 0.0, cx - bounds[0], 0.0],
            [-fx, 0.0, bounds[2] - cx, 0.0],
            [0.0, fy, cy - bounds[1], 0.0],
            [0.0, -fy, bounds[3] - cy, 0.0],
        ]
    )


@compiled("groups i0 view f2! u1!", inner=True, allocates=False, groups=GROUPS, view=VIEW)
def mark_near(groups: Groups, edges: int, view: View, planes: Array, near: NDArray[np.uint8]) -> int:
    """Mark the edges of the groups that planes (BORDERS, 4) do not exclude, among so many edges; their number."""
    R, t, spheres, marked = view.R, view.t, groups.spheres, 0
    for g in range(len(spheres)):
        x, y, z = spheres[g, 0], spheres[g, 1], spheres[g, 2]
        u = t[0] + R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        v = t[1] + R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        w = t[2] + R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        beyond = False
        for k in range(BORDERS):
            a, b, c = planes[k, 0], planes[k, 1], planes[k, 2]
            away = a * u + b * v + c * w + planes[k, 3]
            beyond |= away < -(1.0 + ROUNDING) * spheres[g, 3] * math.sqrt(a * a + b * b + c * c)
        if beyond:
            continue
        first, last = g * GROUP, min(edges, (g + 1) * GROUP)
        for i in range(first, last):
            near[groups.order[i]] = 1
        marked += last - first
    return marked


@compiled("edges view", inner=True, edges=EDGE_MAP, view=VIEW)
def visible_parts(edges: EdgeMap, view: View) -> VisibleParts:
    """Parts of the edges of visible faces within the image (Liang & Barsky 1984), without hidden-line removal."""
    ends, faces, smooth, planes, R, t = edges.ends, edges.faces, edges.smooth, edges.planes, view.R, view.t
    eye, clip = camera_centre(R, t), borders(view)
    fx, fy = view.lens[0], view.lens[1]
    near = np.zeros((len(ends) + WORD - 1) // WORD * WORD, np.uint8)
    most = mark_near(edges.groups, len(ends), view, clip, near)
    edges.in_last_view[0] = most
    rows, visible = np.empty(most, np.int64), np.empty(most, np.int64)
    part, depth, length = np.empty((most, 2)), np.empty((most, 2)), np.empty(most)
    words, n = near.view(np.int64), 0
    for word in range(len(words)):
        if words[word] == 0:
            continue
        for e in range(word * WORD, (word + 1) * WORD):
            if near[e] == 0:
                continue
            state = 0
            for side in range(2):
                f = faces[e, side]
                if f >= 0:
                    towards = planes[f, 0] * eye[0] + planes[f, 1] * eye[1] + planes[f, 2] * eye[2] - planes[f, 3]
                    if towards > 0.0:
                        state |= 1 << side
            if state == 0 or (state == BOTH_FACES and smooth[e]):
                continue
            a, b = in_camera(R, t, ends, e, 0), in_camera(R, t, ends, e, 1)
            low, high = clip_segment(a, b, clip)
            if low >= high:
                continue
            z0, z1 = a[2] + low * (b[2] - a[2]), a[2] + high * (b[2] - a[2])
            du = (a[0] + high * (b[0] - a[0])) / z1 - (a[0] + low * (b[0] - a[0])) / z0
            dv = (a[1] + high * (b[1] - a[1])) / z1 - (a[1] + low * (b[1] - a[1])) / z0
            rows[n], visible[n] = e, state
            part[n, 0], part[n, 1], depth[n, 0], depth[n, 1] = low, high, z0, z1
            length[n] = math.sqrt(fx * fx * du * du + fy * fy * dv * dv)
            n += 1
    return VisibleParts(rows[:n], visible[:n], part[:n], depth[:n], length[:n])
