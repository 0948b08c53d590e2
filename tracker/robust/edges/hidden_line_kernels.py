"""Compiled hidden-line removal: which triangle of the structure occludes a point of an edge."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.geometry_kernels import Point
from uavbench.trajectories.geometry.bvh import Tree
from uavbench.trajectories.geometry.ray_triangle import ray_triangle
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled, inlined
from uavbench.trajectories.pose import Array

MARGIN = 5e-4
"""Tolerance: a triangle closer to the point than this fraction of the point's distance does not occlude it."""
STACK = 64
NONE = -1
"""In place of a triangle: none occludes the point."""


class Triangles(NamedTuple):
    """Triangles in a tree of boxes.

    corners (m, 3, 3) in the order of the tree; face (m,) of each; boxes (k, 2, 3) low and high corner of each node;
    nodes (k, 2): (first child, second child), or (-first - 1, count) of the triangles of a leaf.
    """

    corners: Array
    face: NDArray[np.int64]
    boxes: Array
    nodes: NDArray[np.int64]

    @classmethod
    def of(cls, tree: Tree, face: NDArray[np.int64]) -> "Triangles":
        """Triangles of a tree, with the face (m,) of each in the order before the tree was built."""
        inner = np.column_stack([tree.child, tree.child + 1])
        leaf = np.column_stack([-tree.first - 1, tree.counts])
        nodes = np.where(tree.counts[:, None] > 0, leaf, inner)
        return cls(np.array(tree.corners), np.array(face[tree.rows]), np.stack([tree.low, tree.high], axis=1), nodes)


class Sight(NamedTuple):
    """A viewpoint eye (3,), and the stack (STACK,) of nodes to visit next.

    Made once for all points: making the stack takes longer than trying one triangle.
    """

    eye: Array
    stack: NDArray[np.int64]


TRIANGLES = named_tuple(Triangles, "f3! i1! f3! i2!")
SIGHT = named_tuple(Sight, "f1! i1!")


@compiled("f1!", inner=True)
def sight_from(eye: Array) -> Sight:
    """Sight from a viewpoint (3,)."""
    return Sight(eye, np.empty(STACK, np.int64))


@inlined(allocates=False)
def occluder(sight: Sight, point: Point, triangles: Triangles, face_a: int, face_b: int, likely: int) -> int:
    """A triangle that occludes a point of the edge between face_a and face_b, or NONE.

    likely: a triangle that is tried first, or NONE; neighbouring points mostly have the same one.
    """
    corners, face, boxes, nodes = triangles.corners, triangles.face, triangles.boxes, triangles.nodes
    eye, stack = sight.eye, sight.stack
    ray = Point(point.x - eye[0], point.y - eye[1], point.z - eye[2])
    if likely != NONE and face[likely] != face_a and face[likely] != face_b:
        s = ray_triangle(eye, ray, corners[likely, 0], corners[likely, 1], corners[likely, 2])
        if 1e-9 < s < 1.0 - MARGIN:
            return likely
    tiny = 1e-300  # keeps 0 * inf out of the slab test below
    i0, i1, i2 = 1.0 / (ray.x + tiny), 1.0 / (ray.y + tiny), 1.0 / (ray.z + tiny)
    x, y, z = eye[0], eye[1], eye[2]
    from0, from1, from2 = int(i0 < 0.0), int(i1 < 0.0), int(i2 < 0.0)  # the side of a box that the ray enters by
    stack[0] = 0
    depth = 1
    while depth > 0:
        depth -= 1
        node = np.uint32(stack[depth])
        box = boxes[node]
        near = max(max((box[from0, 0] - x) * i0, (box[from1, 1] - y) * i1), (box[from2, 2] - z) * i2)
        far = min(min((box[1 - from0, 0] - x) * i0, (box[1 - from1, 1] - y) * i1), (box[1 - from2, 2] - z) * i2)
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
            s = ray_triangle(eye, ray, corners[m, 0], corners[m, 1], corners[m, 2])
            if 1e-9 < s < 1.0 - MARGIN:
                return m
    return NONE


@compiled("sight f1 triangles i0 i0", inner=True, allocates=False, sight=SIGHT, triangles=TRIANGLES)
def hidden(sight: Sight, point: Array, triangles: Triangles, face_a: int, face_b: int) -> bool:
    """Whether a triangle occludes a point (3,) of the edge between face_a and face_b."""
    at = Point(point[0], point[1], point[2])
    return occluder(sight, at, triangles, face_a, face_b, NONE) != NONE
