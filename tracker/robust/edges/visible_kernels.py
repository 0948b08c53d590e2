"""Compiled search for the edges of visible faces within an image, without hidden-line removal."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import Point, camera_centre, clip_segment
from uavbench.tracker.robust.edges.columns import BOTH_FACES
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

Indices = NDArray[np.int64]


class VisibleParts(NamedTuple):
    """The part of each edge (e,) within the image.

    faces (e,) bits of the visible faces beside it, 0 if it is not visible; part (e, 2) start and end of the part as
    fractions of the edge; depth (e, 2) at these; length_px (e,) projected length.
    """

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


@compiled("edges view", inner=True, edges=EDGE_MAP, view=VIEW)
def visible_parts(edges: EdgeMap, view: View) -> VisibleParts:
    """Parts of the edges of visible faces within the image (Liang & Barsky 1984), without hidden-line removal."""
    ends, faces, smooth, planes, R, t = edges.ends, edges.faces, edges.smooth, edges.planes, view.R, view.t
    eye = camera_centre(R, t)
    fx, fy, cx, cy = view.lens[0], view.lens[1], view.lens[2], view.lens[3]
    bounds = view.bounds_px
    clip = np.array(
        [
            [0.0, 0.0, 1.0, -view.near],
            [fx, 0.0, cx - bounds[0], 0.0],
            [-fx, 0.0, bounds[2] - cx, 0.0],
            [0.0, fy, cy - bounds[1], 0.0],
            [0.0, -fy, bounds[3] - cy, 0.0],
        ]
    )
    n_edges = len(ends)
    visible = np.zeros(n_edges, np.int64)
    part = np.empty((n_edges, 2))
    depth = np.empty((n_edges, 2))
    length = np.zeros(n_edges)
    for e in range(n_edges):
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
        visible[e] = state
        part[e, 0], part[e, 1], depth[e, 0], depth[e, 1] = low, high, z0, z1
        length[e] = math.sqrt(fx * fx * du * du + fy * fy * dv * dv)
    return VisibleParts(visible, part, depth, length)
