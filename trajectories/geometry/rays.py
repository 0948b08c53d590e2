"""Ray casting against a triangle mesh: first hits, occlusion, and signed surface crossings."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.geometry.bvh import MAX_DEPTH, TREE, Tree
from uavbench.trajectories.geometry.ray_triangle import ray_triangle
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

UP_A_LITTLE_ASKEW = np.array([0.0127, 0.0291, 1.0])
"""Ray direction that is not parallel to any edge or face of an axis-aligned mesh."""


def ray_distances(tree: Tree, origins: Array, directions: Array) -> Array:
    """Distance (k,) along each unit direction to the first triangle, inf where there is none."""
    out = np.empty((len(origins), 1))
    _distances(tree, origins, directions[:, None], np.inf, False, out)
    return out[:, 0]


class Hit(NamedTuple):
    """Distance to a triangle and its index in the tree, -1 for none."""

    distance: float
    place: int


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits of rays: distances (k,), inf for none, and rows (k,) of the mesh, -1 for none."""

    distances: Array
    rows: NDArray[np.int64]


def first_hits(tree: Tree, origins: Array, directions: Array) -> Hits:
    """Distance along each unit direction (k, 3) from origins (k, 3) to the first triangle, and its row."""
    distances, places = np.empty(len(origins)), np.empty(len(origins), dtype=np.int64)
    _hits(tree, origins, directions, distances, places)
    return Hits(distances, np.where(places < 0, -1, tree.rows[places]))


def rays_blocked(tree: Tree, origins: Array, directions: Array, within: float) -> NDArray[np.bool_]:
    """Mask (n, k) of rays from origins (n, 3) along unit directions (n, k, 3) that hit a triangle within `within`."""
    out = np.empty(directions.shape[:2])
    _distances(tree, origins, directions, within, True, out)
    return out < within


def are_inside(tree: Tree, points: Array) -> NDArray[np.bool_]:
    """Mask (k,) of points (k, 3) inside the mesh: rays up and down both exit it more often than they enter.

    Solids may thus overlap or touch, and a sheet without thickness has no interior.
    """
    up, down = (mesh_crossings(tree, points, way * UP_A_LITTLE_ASKEW) for way in (1.0, -1.0))
    return np.asarray(up * down > 0)


def mesh_crossings(tree: Tree, origins: Array, direction: Array) -> NDArray[np.int64]:
    """Number (k,) of exits minus entries of a ray from each origin (k, 3) along a direction (3,)."""
    out = np.empty(len(origins), dtype=np.int64)
    _crossings(tree, origins, direction, out)
    return out


@compiled
def _first(tree: Tree, o: Array, d: Array, within: float, any_will_do: bool, stack: NDArray[np.int64]) -> Hit:
    """The first, or any, triangle that a ray hits nearer than `within`; `stack` (MAX_DEPTH,) is traversal memory."""
    best, place = within, -1
    stack[0] = 0
    top = 1
    while top > 0 and not (any_will_do and best < within):
        top -= 1
        node = stack[top]
        if not _enters(o, d, tree.low[node], tree.high[node], best):
            continue
        if tree.counts[node] > 0:
            for t in range(tree.first[node], tree.first[node] + tree.counts[node]):
                distance = ray_triangle(o, d, tree.corners[t, 0], tree.corners[t, 1], tree.corners[t, 2])
                if distance < best:
                    best, place = distance, t
        else:
            stack[top] = tree.child[node]
            stack[top + 1] = tree.child[node] + 1
            top += 2
    return Hit(best, place)


@compiled("Tree f2~ f3~ f0 b0 f2!", Tree=TREE)
def _distances(tree: Tree, origins: Array, directions: Array, within: float, any_will_do: bool, out: Array) -> None:
    """Distance (n, k) to the first triangle, or to any, nearer than `within`; `within` where there is none."""
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(directions.shape[0]):
        for j in range(directions.shape[1]):
            out[i, j] = _first(tree, origins[i], directions[i, j], within, any_will_do, stack).distance


@compiled("Tree f2 f2 f1! i1!", Tree=TREE)
def _hits(tree: Tree, origins: Array, directions: Array, out: Array, place: NDArray[np.int64]) -> None:
    """Distance (k,) to the first triangle, inf for none, and its index (k,) in the tree, -1 for none."""
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(origins.shape[0]):
        hit = _first(tree, origins[i], directions[i], np.inf, False, stack)
        out[i], place[i] = hit.distance, hit.place


@compiled("Tree f2 f1 i1!", Tree=TREE)
def _crossings(tree: Tree, origins: Array, direction: Array, out: NDArray[np.int64]) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(origins.shape[0]):
        out[i] = 0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not _enters(origins[i], direction, tree.low[node], tree.high[node], np.inf):
                continue
            if tree.counts[node] > 0:
                for t in range(tree.first[node], tree.first[node] + tree.counts[node]):
                    a, b, c = tree.corners[t, 0], tree.corners[t, 1], tree.corners[t, 2]
                    if ray_triangle(origins[i], direction, a, b, c) < np.inf:
                        out[i] += _side(direction, a, b, c)
            else:
                stack[top] = tree.child[node]
                stack[top + 1] = tree.child[node] + 1
                top += 2


@compiled("f1~ f1~ f1 f1 f0", inner=True)
def _enters(origin: Array, direction: Array, low: Array, high: Array, far: float) -> bool:
    """Whether a ray hits a box within `far`."""
    near = 0.0
    for k in range(3):
        if direction[k] == 0.0:
            if origin[k] < low[k] or origin[k] > high[k]:
                return False
        else:
            a = (low[k] - origin[k]) / direction[k]
            b = (high[k] - origin[k]) / direction[k]
            near, far = max(near, min(a, b)), min(far, max(a, b))
    return near <= far


@compiled
def _side(direction: Array, a: Array, b: Array, c: Array) -> int:
    """1 where a ray exits through a triangle, -1 where it enters."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    along = direction[0] * (uy * vz - uz * vy) + direction[1] * (uz * vx - ux * vz) + direction[2] * (ux * vy - uy * vx)
    return 1 if along > 0.0 else -1
