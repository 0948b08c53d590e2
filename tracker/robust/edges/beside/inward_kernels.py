"""Compiled search for the side of an edge on which each of its faces lies."""

import math

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.robust.edges.hidden_line_kernels import NONE, STACK, TRIANGLES, Triangles
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

ALONG = 0.4567
"""Part of an edge at whose end its faces are looked for: a place that is no vertex of a regular mesh."""
BESIDE = 1e-6
"""Distance from an edge within which its faces are looked for first, in diagonals of the structure: more than rounding
makes of it, and less than most triangles are apart."""
LEAST = 1e-12
"""Least length of a vector that is divided by it, in the unit of the model."""

Indices = NDArray[np.int64]


@compiled("f1! f2!", inner=True)
def squared_to_sides(point: Array, corners: Array) -> float:
    """Squared distance of a point (3,) to the nearest side of a triangle (3, 3)."""
    least = np.inf
    for i in range(3):
        j, along, length = (i + 1) % 3, 0.0, 0.0
        for k in range(3):
            side = corners[j, k] - corners[i, k]
            along += (point[k] - corners[i, k]) * side
            length += side * side
        part = min(1.0, max(0.0, along / length)) if length > 0.0 else 0.0
        squared = 0.0
        for k in range(3):
            away = point[k] - corners[i, k] - part * (corners[j, k] - corners[i, k])
            squared += away * away
        least = min(least, squared)
    return least


@compiled("f1! f3! i0", inner=True)
def squared_to_box(point: Array, boxes: Array, node: int) -> float:
    """Squared distance of a point (3,) to the box of a node, 0 within it."""
    squared = 0.0
    for k in range(3):
        away = max(0.0, max(boxes[node, 0, k] - point[k], point[k] - boxes[node, 1, k]))
        squared += away * away
    return squared


@compiled("f1! i0 f0 triangles i1!", inner=True, triangles=TRIANGLES)
def nearest_of_face(point: Array, face: int, within: float, triangles: Triangles, stack: Indices) -> int:
    """The triangle of a face one of whose sides is the nearest to a point (3,), and within a distance; NONE."""
    nodes, best, nearest = triangles.nodes, within * within, NONE
    stack[0], depth = 0, 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if squared_to_box(point, triangles.boxes, node) > best:
            continue
        if nodes[node, 0] >= 0:
            near, far = nodes[node, 0], nodes[node, 1]
            if squared_to_box(point, triangles.boxes, far) < squared_to_box(point, triangles.boxes, near):
                near, far = far, near
            stack[depth], stack[depth + 1] = far, near
            depth += 2
            continue
        first = -nodes[node, 0] - 1
        for m in range(first, first + nodes[node, 1]):
            if triangles.face[m] == face:
                squared = squared_to_sides(point, triangles.corners[m])
                if squared < best:
                    best, nearest = squared, m
    return nearest


@compiled("f3! i2! triangles f0", triangles=TRIANGLES)
def into_faces(ends: Array, faces: Indices, triangles: Triangles, size: float) -> Array:
    """Unit vectors (e, 2, 3) perpendicular to each edge, into the adjacent triangle of either face; 0 for no face.

    ends (e, 2, 3), faces (e, 2): those of `EdgeMap`; size: diagonal of the structure.
    """
    out, stack = np.zeros((len(ends), 2, 3)), np.empty(STACK, np.int64)
    place, into = np.empty(3), np.empty(3)
    for e in range(len(ends)):
        length = 0.0
        for k in range(3):
            along = ends[e, 1, k] - ends[e, 0, k]
            place[k] = ends[e, 0, k] + ALONG * along
            length += along * along
        for side in range(2):
            if faces[e, side] < 0:
                continue
            nearest = nearest_of_face(place, faces[e, side], BESIDE * size, triangles, stack)
            if nearest == NONE:
                nearest = nearest_of_face(place, faces[e, side], np.inf, triangles, stack)
            corners = triangles.corners[nearest]
            ahead, squared = 0.0, 0.0
            for k in range(3):
                into[k] = (corners[0, k] + corners[1, k] + corners[2, k]) / 3.0 - place[k]
                ahead += into[k] * (ends[e, 1, k] - ends[e, 0, k]) / length
            for k in range(3):
                into[k] -= ahead * (ends[e, 1, k] - ends[e, 0, k])
                squared += into[k] * into[k]
            for k in range(3):
                out[e, side, k] = into[k] / max(math.sqrt(squared), LEAST)
    return out
