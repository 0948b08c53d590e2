"""Compiled hidden-line removal: does a triangle of the structure stand between the camera and a point of an edge."""

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

LEAF_TRIANGLES = 4
MARGIN = 5e-4
"""A triangle nearer to the point than this part of its distance does not hide it."""
STACK = 64


def build_tree(corners: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Bounding volume tree of triangles (m, 3, 3): boxes (k, 2, 3), nodes (k, 2), order (m,) of the triangles.

    A node is (left, right) children, or (-first - 1, count) of a leaf in `order`.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    centre = (low + high) / 2
    order = np.arange(len(corners))
    boxes: list[Array] = []
    nodes: list[list[int]] = []

    def split(first: int, last: int) -> int:
        rows = order[first:last]
        me = len(nodes)
        boxes.append(np.array([low[rows].min(axis=0), high[rows].max(axis=0)]))
        nodes.append([-first - 1, last - first])
        if last - first > LEAF_TRIANGLES:
            axis = int(np.argmax(np.ptp(centre[rows], axis=0)))
            order[first:last] = rows[np.argsort(centre[rows, axis], kind="stable")]
            middle = (first + last) // 2
            nodes[me] = [split(first, middle), split(middle, last)]
        return me

    split(0, len(corners))
    return np.array(boxes), np.array(nodes, dtype=np.int64), order


@compiled("f1 f1 f3 i1 f3 i2 i0 i0")
def hidden(
    eye: Array,
    point: Array,
    corners: Array,
    face: NDArray[np.int64],
    boxes: Array,
    nodes: NDArray[np.int64],
    face_a: int,
    face_b: int,
) -> bool:
    """Whether a triangle hides a point of the edge between face_a and face_b (Moller & Trumbore 1997)."""
    d0, d1, d2 = point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]
    tiny = 1e-300  # keeps 0 * inf out of the slab test below
    i0, i1, i2 = 1.0 / (d0 + tiny), 1.0 / (d1 + tiny), 1.0 / (d2 + tiny)
    stack = np.empty(STACK, np.int64)
    stack[0] = 0
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        a, b = (boxes[node, 0, 0] - eye[0]) * i0, (boxes[node, 1, 0] - eye[0]) * i0
        near, far = min(a, b), max(a, b)
        a, b = (boxes[node, 0, 1] - eye[1]) * i1, (boxes[node, 1, 1] - eye[1]) * i1
        near, far = max(near, min(a, b)), min(far, max(a, b))
        a, b = (boxes[node, 0, 2] - eye[2]) * i2, (boxes[node, 1, 2] - eye[2]) * i2
        near, far = max(near, min(a, b)), min(far, max(a, b))
        if near > far or far < 0.0 or near > 1.0 - MARGIN:
            continue
        if nodes[node, 0] >= 0:
            stack[depth], stack[depth + 1] = nodes[node, 0], nodes[node, 1]
            depth += 2
            continue
        first = -nodes[node, 0] - 1
        for m in range(first, first + nodes[node, 1]):
            if face[m] == face_a or face[m] == face_b:
                continue
            e0, e1, e2 = corners[m, 1, 0] - corners[m, 0, 0], corners[m, 1, 1] - corners[m, 0, 1], 0.0
            e2 = corners[m, 1, 2] - corners[m, 0, 2]
            f0, f1 = corners[m, 2, 0] - corners[m, 0, 0], corners[m, 2, 1] - corners[m, 0, 1]
            f2 = corners[m, 2, 2] - corners[m, 0, 2]
            p0, p1, p2 = d1 * f2 - d2 * f1, d2 * f0 - d0 * f2, d0 * f1 - d1 * f0
            det = e0 * p0 + e1 * p1 + e2 * p2
            if det == 0.0:
                continue
            s0, s1, s2 = eye[0] - corners[m, 0, 0], eye[1] - corners[m, 0, 1], eye[2] - corners[m, 0, 2]
            u = (s0 * p0 + s1 * p1 + s2 * p2) / det
            if u < 0.0 or u > 1.0:
                continue
            q0, q1, q2 = s1 * e2 - s2 * e1, s2 * e0 - s0 * e2, s0 * e1 - s1 * e0
            v = (d0 * q0 + d1 * q1 + d2 * q2) / det
            if v < 0.0 or u + v > 1.0:
                continue
            s = (f0 * q0 + f1 * q1 + f2 * q2) / det
            if 1e-9 < s < 1.0 - MARGIN:
                return True
    return False
