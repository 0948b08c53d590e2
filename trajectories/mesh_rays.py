"""Rays against a triangle mesh: how far to the first triangle, and how often through its surface."""

import numpy as np
from numpy.typing import NDArray

from trajectories.kernels import compiled
from trajectories.mesh_tree import MAX_DEPTH, Tree
from trajectories.pose import Array


def ray_distances(tree: Tree, origins: Array, directions: Array) -> Array:
    """Distance (k,) along each unit direction to the first triangle, inf where there is none."""
    out = np.empty(len(origins))
    _rays(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, origins, directions, out)
    return out


def rays_blocked(tree: Tree, origins: Array, directions: Array, within: float) -> NDArray[np.bool_]:
    """Which rays (n, k), in unit directions (n, k, 3) from origins (n, 3), meet a triangle nearer than `within`."""
    out = np.empty(directions.shape[:2], dtype=np.bool_)
    _blocked(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, origins, directions, within, out)
    return out


def mesh_crossings(tree: Tree, origins: Array, direction: Array) -> NDArray[np.int64]:
    """Times (k,) that a ray from each origin (k, 3) leaves the mesh, less the times it enters."""
    out = np.empty(len(origins), dtype=np.int64)
    _crossings(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, origins, direction, out)
    return out


@compiled
def _rays(
    low: Array,
    high: Array,
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    child: NDArray[np.int64],
    corners: Array,
    origins: Array,
    directions: Array,
    out: Array,
) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(origins.shape[0]):
        best = np.inf
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not _enters(origins[i], directions[i], low[node], high[node], best):
                continue
            if count[node] > 0:
                for t in range(first[node], first[node] + count[node]):
                    hit = _ray_triangle(origins[i], directions[i], corners[t, 0], corners[t, 1], corners[t, 2])
                    best = min(best, hit)
            else:
                stack[top] = child[node]
                stack[top + 1] = child[node] + 1
                top += 2
        out[i] = best


@compiled
def _blocked(
    low: Array,
    high: Array,
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    child: NDArray[np.int64],
    corners: Array,
    origins: Array,
    directions: Array,
    within: float,
    out: NDArray[np.bool_],
) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(directions.shape[0]):
        last = 0
        for j in range(directions.shape[1]):
            a, b, c = corners[last, 0], corners[last, 1], corners[last, 2]
            found = _ray_triangle(origins[i], directions[i, j], a, b, c) < within  # what hid the ray before this one
            stack[0] = 0
            top = 1
            while top > 0 and not found:
                top -= 1
                node = stack[top]
                if not _enters(origins[i], directions[i, j], low[node], high[node], within):
                    continue
                if count[node] > 0:
                    for t in range(first[node], first[node] + count[node]):
                        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
                        if _ray_triangle(origins[i], directions[i, j], a, b, c) < within:
                            found = True
                            last = t
                            break
                else:
                    stack[top] = child[node]
                    stack[top + 1] = child[node] + 1
                    top += 2
            out[i, j] = found


@compiled
def _crossings(
    low: Array,
    high: Array,
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    child: NDArray[np.int64],
    corners: Array,
    origins: Array,
    direction: Array,
    out: NDArray[np.int64],
) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(origins.shape[0]):
        out[i] = 0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not _enters(origins[i], direction, low[node], high[node], np.inf):
                continue
            if count[node] > 0:
                for t in range(first[node], first[node] + count[node]):
                    a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
                    if _ray_triangle(origins[i], direction, a, b, c) < np.inf:
                        out[i] += _side(direction, a, b, c)
            else:
                stack[top] = child[node]
                stack[top + 1] = child[node] + 1
                top += 2


@compiled
def _enters(origin: Array, direction: Array, low: Array, high: Array, far: float) -> bool:
    """Whether a ray meets a box within `far`."""
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
def _ray_triangle(o: Array, d: Array, a: Array, b: Array, c: Array) -> float:
    """Distance along a ray to a triangle, inf when it misses (Moller & Trumbore 1997)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = d[1] * vz - d[2] * vy, d[2] * vx - d[0] * vz, d[0] * vy - d[1] * vx
    determinant = ux * px + uy * py + uz * pz
    if determinant == 0.0:
        return float(np.inf)
    tx, ty, tz = o[0] - a[0], o[1] - a[1], o[2] - a[2]
    beta = (tx * px + ty * py + tz * pz) / determinant
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    gamma = (d[0] * qx + d[1] * qy + d[2] * qz) / determinant
    if beta < 0.0 or gamma < 0.0 or beta + gamma > 1.0:
        return float(np.inf)
    distance = (vx * qx + vy * qy + vz * qz) / determinant
    return float(distance) if distance > 0.0 else float(np.inf)


@compiled
def _side(direction: Array, a: Array, b: Array, c: Array) -> int:
    """1 where a ray leaves through a triangle's outside, -1 where it enters."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    along = direction[0] * (uy * vz - uz * vy) + direction[1] * (uz * vx - ux * vz) + direction[2] * (ux * vy - uy * vx)
    return 1 if along > 0.0 else -1
