"""Distances and rays against a triangle mesh, by a tree of bounding boxes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajectories.kernels import compiled
from trajectories.pose import Array

LEAF = 4
"""Triangles in a leaf of the tree."""
MAX_DEPTH = 64
"""Entries that the search stack holds; a balanced tree of 2^60 leaves fits."""


class Tree(NamedTuple):
    """Balanced tree: low, high (k, 3) boxes of the nodes; first, counts (k,) the triangles of a leaf (counts 0: inner);
    child (k,) the first of the two children, which follow each other; corners (m, 3, 3) triangles in leaf order.
    """

    low: Array
    high: Array
    first: NDArray[np.int64]
    counts: NDArray[np.int64]
    child: NDArray[np.int64]
    corners: Array


def build_tree(corners: Array) -> Tree:
    """Tree of triangles (m, 3, 3), split at the median along the longest side of each box."""
    middle = corners.mean(axis=1)
    order = np.arange(len(corners))
    boxes: list[tuple[Array, Array]] = []
    first, count, child = [0], [0], [0]
    spans = [(0, len(corners))]
    node = 0
    while node < len(spans):
        begin, end = spans[node]
        rows = order[begin:end]
        low, high = corners[rows].min(axis=(0, 1)), corners[rows].max(axis=(0, 1))
        boxes.append((low, high))
        if end - begin <= LEAF:
            first[node], count[node] = begin, end - begin
        else:
            axis = int(np.argmax(high - low))
            order[begin:end] = rows[np.argsort(middle[rows, axis], kind="stable")]
            half = (begin + end) // 2
            child[node] = len(spans)
            for span in ((begin, half), (half, end)):
                spans.append(span)
                first.append(0)
                count.append(0)
                child.append(0)
        node += 1
    low, high = (np.ascontiguousarray([box[k] for box in boxes]) for k in range(2))
    return Tree(low, high, np.array(first), np.array(count), np.array(child), np.ascontiguousarray(corners[order]))


def mesh_distances(tree: Tree, points: Array) -> Array:
    """Distance (k,) of points (k, 3) to the nearest triangle."""
    out = np.empty(len(points))
    _distances(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, points, out)
    return out


def ray_distances(tree: Tree, origins: Array, directions: Array) -> Array:
    """Distance (k,) along each unit direction to the first triangle, inf where there is none."""
    out = np.empty(len(origins))
    _rays(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, origins, directions, out)
    return out


def mesh_crossings(tree: Tree, origins: Array, direction: Array) -> NDArray[np.int64]:
    """Times (k,) that a ray from each origin (k, 3) leaves the mesh, less the times it enters."""
    out = np.empty(len(origins), dtype=np.int64)
    _crossings(tree.low, tree.high, tree.first, tree.counts, tree.child, tree.corners, origins, direction, out)
    return out


@compiled
def _segment_squared(p: Array, a: Array, b: Array) -> float:
    """Squared distance of a point to a segment."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ex, ey, ez = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    length = dx * dx + dy * dy + dz * dz
    t = 0.0 if length == 0.0 else min(1.0, max(0.0, (ex * dx + ey * dy + ez * dz) / length))
    x, y, z = ex - t * dx, ey - t * dy, ez - t * dz
    return float(x * x + y * y + z * z)


@compiled
def _triangle_squared(p: Array, a: Array, b: Array, c: Array) -> float:
    """Squared distance of a point to a triangle: to its plane above its inside, else to the nearest side."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        beta = (nx * (wy * vz - wz * vy) + ny * (wz * vx - wx * vz) + nz * (wx * vy - wy * vx)) / nn
        gamma = (nx * (uy * wz - uz * wy) + ny * (uz * wx - ux * wz) + nz * (ux * wy - uy * wx)) / nn
        if beta >= 0.0 and gamma >= 0.0 and beta + gamma <= 1.0:
            height = nx * wx + ny * wy + nz * wz
            return float(height * height / nn)
    return min(_segment_squared(p, a, b), _segment_squared(p, b, c), _segment_squared(p, c, a))


@compiled
def _box_squared(p: Array, low: Array, high: Array) -> float:
    """Squared distance of a point to an axis-aligned box."""
    total = 0.0
    for k in range(3):
        gap = max(low[k] - p[k], p[k] - high[k], 0.0)
        total += gap * gap
    return total


@compiled
def _distances(
    low: Array,
    high: Array,
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    child: NDArray[np.int64],
    corners: Array,
    points: Array,
    out: Array,
) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(points.shape[0]):
        p = points[i]
        best = np.inf
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _box_squared(p, low[node], high[node]) >= best:
                continue
            if count[node] > 0:
                for t in range(first[node], first[node] + count[node]):
                    best = min(best, _triangle_squared(p, corners[t, 0], corners[t, 1], corners[t, 2]))
            else:
                a = child[node]
                near_a = _box_squared(p, low[a], high[a]) <= _box_squared(p, low[a + 1], high[a + 1])
                stack[top] = a + 1 if near_a else a
                stack[top + 1] = a if near_a else a + 1
                top += 2
        out[i] = np.sqrt(best)


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
def _side(direction: Array, a: Array, b: Array, c: Array) -> int:
    """1 where a ray leaves through a triangle's outside, -1 where it enters."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    along = direction[0] * (uy * vz - uz * vy) + direction[1] * (uz * vx - ux * vz) + direction[2] * (ux * vy - uy * vx)
    return 1 if along > 0.0 else -1
