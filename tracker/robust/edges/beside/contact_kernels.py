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


@compiled("f2! f3! i0 f0", inner=True, allocates=False)
def passes(line: Array, boxes: Array, node: int, apart: float) -> bool:
    """Whether a line from one point (3,) to another one passes within `apart` of the box of a node."""
    low, high = 0.0, 1.0
    for k in range(3):
        start, along = line[0, k], line[1, k] - line[0, k]
        below, above = boxes[node, 0, k] - apart - start, boxes[node, 1, k] + apart - start
        if along == 0.0:
            if below > 0.0 or above < 0.0:
                return False
            continue
        one, other = below / along, above / along
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return low <= high


@compiled("f2! f1! f0 triangles f2! i1! u1!", inner=True, triangles=TRIANGLES)
def note_faces(
    line: Array,
    normal: Array,
    apart: float,
    triangles: Triangles,
    planes: Array,
    own: Indices,
    found: NDArray[np.uint8],
) -> None:
    """Note the faces, other than `own` (2,), that lie within `apart` of places of a plane, parallel to it.

    The places are the middles of PARTS parts of a line (2, 3); found (PARTS,) their bits, which are added.
    """
    corners, face, nodes = triangles.corners, triangles.face, triangles.nodes
    stack, place = np.empty(STACK, np.int64), np.empty(3)
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if not passes(line, triangles.boxes, node, apart):
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
            if abs(along) < PARALLEL:
                continue
            for part in range(PARTS):
                s, away = (part + 0.5) / PARTS, -planes[f, 3]
                for k in range(3):
                    place[k] = line[0, k] + s * (line[1, k] - line[0, k])
                    away += planes[f, k] * place[k]
                if abs(away) <= apart and covers(place, corners[m, 0], corners[m, 1], corners[m, 2]):
                    found[part] |= SAME_WAY if along > 0.0 else OPPOSITE


@compiled("f3! i2! f3! f2! triangles f0", triangles=TRIANGLES)
def faces_beside(
    ends: Array, faces: Indices, inward: Array, planes: Array, triangles: Triangles, size: float
) -> NDArray[np.uint8]:
    """Bits of other faces in the plane of each face of each edge (e, 2, 2, PARTS), beside each part of the edge.

    The second axis is the face, the third WITHIN or BEYOND: on the face, or where it would go on across the edge. The
    arrays are those of `EdgeMap`; size: diagonal of the structure.
    """
    found = np.zeros((len(ends), 2, 2, PARTS), np.uint8)
    line, normal = np.empty((2, 3)), np.empty(3)
    for e in range(len(ends)):
        for side in range(2):
            if faces[e, side] < 0:
                continue
            for k in range(3):
                normal[k] = planes[faces[e, side], k]
            for across in range(2):
                away = BESIDE_EDGE * size * (1.0 if across == WITHIN else -1.0)
                for end in range(2):
                    for k in range(3):
                        line[end, k] = ends[e, end, k] + away * inward[e, side, k]
                note_faces(line, normal, COPLANAR * size, triangles, planes, faces[e], found[e, side, across])
    return found
