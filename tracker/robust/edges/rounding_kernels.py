"""Compiled motion of edges by the radius of rounded borders.

A model's borders are sharp, those of a structure are rounded. With n1 and n2 the normals of two faces, their border is
at r (n1 + n2) / (1 + n1 . n2) from the axis of a cylinder of radius r that touches both. Where one of them is visible,
the outline of the cylinder is at r d, with d across the line of sight and the border. Where both are, the light changes
from r n1 to r n2, on average at r (n1 + n2) / 2. Borders that recede, as of a floor and a wall, stay sharp.
"""

import math
from typing import NamedTuple

import numpy as np

from uavbench.tracker.geometry_kernels import camera_centre
from uavbench.tracker.robust.edges.columns import BOTH_FACES, EDGE, FACES
from uavbench.tracker.robust.edges.edge_graph import EDGE_MAP, EdgeMap
from uavbench.tracker.robust.edges.measurements import CONTROL_POINTS, SEARCH_LINES, ControlPoints, SearchLines
from uavbench.tracker.robust.view import VIEW, View
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

MOST_REACH = 2.0
"""Most of 1 / (1 + n1 . n2), that of a wedge of 60 degrees: thin plates have no room for the radius of others."""


class Rounding(NamedTuple):
    """Radius by which edges are located, and the unit of radii, m; how many numbers all edges share, it the last."""

    radius_m: float
    unit_m: float
    numbers: int


ROUNDING = named_tuple(Rounding, "f0 f0 i0")


@compiled("points edges view", inner=True, points=CONTROL_POINTS, edges=EDGE_MAP, view=VIEW)
def motion_by_radius(points: ControlPoints, edges: EdgeMap, view: View) -> Array:
    """Motion (n, 3) of control points in the world for a unit of the radius."""
    places, keys, ends, faces, planes = points.points, points.keys, edges.ends, edges.faces, edges.planes
    eye, motion = camera_centre(view.R, view.t), np.zeros((len(places), 3))
    along, ray, across = np.empty(3), np.empty(3), np.empty(3)
    for p in range(len(places)):
        e = keys[p, EDGE]
        one, other = faces[e, 0], faces[e, 1]
        if one < 0 or other < 0:
            continue
        cosine, recedes = 0.0, 0.0
        for i in range(3):
            cosine += planes[one, i] * planes[other, i]
            recedes += edges.inward[e, 0, i] * planes[other, i]
        reach = 1.0 / max(1.0 + cosine, 1.0 / MOST_REACH)
        if recedes > 0.0:
            continue
        if keys[p, FACES] == BOTH_FACES:
            for i in range(3):
                motion[p, i] = (0.5 - reach) * (planes[one, i] + planes[other, i])
            continue
        for i in range(3):
            along[i], ray[i] = ends[e, 1, i] - ends[e, 0, i], places[p, i] - eye[i]
        square, outwards = 0.0, 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            across[i] = along[j] * ray[k] - along[k] * ray[j]
            square += across[i] * across[i]
            outwards += across[i] * (planes[one, i] + planes[other, i])
        if square > 0.0:
            length = math.sqrt(square)
            inset = max(abs(outwards) / length * reach - 1.0, 0.0)
            for i in range(3):
                motion[p, i] = -math.copysign(inset, outwards) * across[i] / length
    return motion


@compiled("points f2 f0", inner=True, allocates=False, points=CONTROL_POINTS)
def move(points: ControlPoints, motion: Array, times: float) -> None:
    """Move control points by a multiple of a motion (n, 3), in place."""
    for p in range(len(motion)):
        for i in range(3):
            points.points[p, i] += times * motion[p, i]


@compiled("lines f2 f0 view", inner=True, lines=SEARCH_LINES, view=VIEW)
def derivatives(lines: SearchLines, motion: Array, times: float, view: View) -> Array:
    """Derivatives (n,) of the distances, px, for a multiple of a motion (n, 3) of the control points in the world."""
    J, R, out = lines.jacobian, view.R, np.zeros(len(motion))
    for p in range(len(motion)):
        for i in range(3):
            turned = R[i, 0] * motion[p, 0] + R[i, 1] * motion[p, 1] + R[i, 2] * motion[p, 2]
            out[p] += times * J[p, i] * turned
    return out
