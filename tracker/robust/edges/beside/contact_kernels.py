"""Compiled search for edges of parts that touch: where faces of two parts lie in one plane, no image shows an edge.

A mesh of several parts has edges that its surface does not have: the side of a step goes on in the side of the next
step, and the side between both steps is covered.
"""

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.hidden_line_kernels import STACK, TRIANGLES, Triangles
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

PARTS = 32
"""Parts of an edge for each of which it is told which faces show."""
COPLANAR = 3e-5
"""Distance of planes that are taken for one, in diagonals of the structure: 1 mm for a bridge of 30 m."""
BESIDE_EDGE = 1e-4
"""Distance from an edge at which its neighbourhood is looked at, in diagonals of the structure: 3 mm for such a bridge.
"""
PARALLEL = float(np.cos(np.radians(0.5)))
"""Least product of the normals of faces that are taken for parallel, see `structure.COPLANAR_ANGLE_DEG`."""
SAME_WAY, OPPOSITE = 1, 2
"""Bits of the outsides of the faces at a place of a plane."""
WITHIN, BEYOND = 0, 1
"""Places beside an edge: on its face, and across the edge from there."""

Indices = NDArray[np.int64]


@compiled("f1! f1! f1! f1!", inner=True)
def covers(point: Array, a: Array, b: Array, c: Array) -> bool:
    """Whether a point (3,) near the plane of a triangle lies above it: barycentric coordinates."""
    aa, ab, bb, pa, pb = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v, p = b[k] - a[k], c[k] - a[k], point[k] - a[k]
        aa += u * u
        ab += u * v
        bb += v * v
        pa += p * u
        pb += p * v
    area = aa * bb - ab * ab
    if area <= 0.0:
        return False
    beta, gamma = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    return beta >= 0.0 and gamma >= 0.0 and beta + gamma <= 1.0


@compiled("f1! f1! f0 triangles f2! i1! i1!", inner=True, triangles=TRIANGLES)
def faces_at(
    point: Array, normal: Array, apart: float, triangles: Triangles, planes: Array, own: Indices, stack: Indices
) -> int:
    """Bits of the faces, other than `own` (2,), that lie within `apart` of a point (3,) of a plane, parallel to it."""
    corners, face, boxes, nodes = triangles.corners, triangles.face, triangles.boxes, triangles.nodes
    stack[0] = 0
    depth, found = 1, 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        outside = False
        for k in range(3):
            if point[k] < boxes[node, 0, k] - apart or point[k] > boxes[node, 1, k] + apart:
                outside = True
        if outside:
            continue
        if nodes[node, 0] >= 0:
            stack[depth], stack[depth + 1] = nodes[node, 0], nodes[node, 1]
            depth += 2
            continue
        first = -nodes[node, 0] - 1
        for m in range(first, first + nodes[node, 1]):
            f = face[m]
            if f == own[0] or f == own[1]:
                continue
            along = planes[f, 0] * normal[0] + planes[f, 1] * normal[1] + planes[f, 2] * normal[2]
            away = planes[f, 0] * point[0] + planes[f, 1] * point[1] + planes[f, 2] * point[2] - planes[f, 3]
            if abs(along) < PARALLEL or abs(away) > apart:
                continue
            if covers(point, corners[m, 0], corners[m, 1], corners[m, 2]):
                found |= SAME_WAY if along > 0.0 else OPPOSITE
    return found


@compiled("f3! i2! f3! f2! triangles f0", triangles=TRIANGLES)
def faces_beside(
    ends: Array, faces: Indices, inward: Array, planes: Array, triangles: Triangles, size: float
) -> NDArray[np.uint8]:
    """Bits of other faces in the plane of each face of each edge (e, 2, 2, PARTS), beside each part of the edge.

    The second axis is the face, the third WITHIN or BEYOND: on the face, or where it would go on across the edge. The
    arrays are those of `EdgeMap`; size: diagonal of the structure.
    """
    found = np.zeros((len(ends), 2, 2, PARTS), np.uint8)
    stack, place, normal = np.empty(STACK, np.int64), np.empty(3), np.empty(3)
    for e in range(len(ends)):
        for side in range(2):
            if faces[e, side] < 0:
                continue
            for k in range(3):
                normal[k] = planes[faces[e, side], k]
            for across in range(2):
                away = BESIDE_EDGE * size * (1.0 if across == WITHIN else -1.0)
                for part in range(PARTS):
                    s = (part + 0.5) / PARTS
                    for k in range(3):
                        place[k] = ends[e, 0, k] + s * (ends[e, 1, k] - ends[e, 0, k]) + away * inward[e, side, k]
                    found[e, side, across, part] = faces_at(
                        place, normal, COPLANAR * size, triangles, planes, faces[e], stack
                    )
    return found
