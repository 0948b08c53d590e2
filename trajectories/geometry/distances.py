"""Distances from points to a triangle mesh."""

import numpy as np

from uavbench.trajectories.geometry.bvh import MAX_DEPTH, TREE, Tree
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array


def mesh_distances(tree: Tree, points: Array) -> Array:
    """Distance (k,) of points (k, 3) to the nearest triangle."""
    out = np.empty(len(points))
    _distances(tree, points, out)
    return out


@compiled("Tree f2 f1!", Tree=TREE)
def _distances(tree: Tree, points: Array, out: Array) -> None:
    stack = np.empty(MAX_DEPTH, dtype=np.int64)
    for i in range(points.shape[0]):
        p = points[i]
        best = np.inf
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _box_squared(p, tree.low[node], tree.high[node]) >= best:
                continue
            if tree.counts[node] > 0:
                for t in range(tree.first[node], tree.first[node] + tree.counts[node]):
                    best = min(best, _triangle_squared(p, tree.corners[t, 0], tree.corners[t, 1], tree.corners[t, 2]))
            else:
                a = tree.child[node]
                near_a = _box_squared(p, tree.low[a], tree.high[a]) <= _box_squared(
                    p, tree.low[a + 1], tree.high[a + 1]
                )
                stack[top] = a + 1 if near_a else a
                stack[top + 1] = a if near_a else a + 1
                top += 2
        out[i] = np.sqrt(best)


@compiled
def _box_squared(p: Array, low: Array, high: Array) -> float:
    """Squared distance of a point to an axis-aligned box."""
    total = 0.0
    for k in range(3):
        gap = max(low[k] - p[k], p[k] - high[k], 0.0)
        total += gap * gap
    return total


@compiled
def _triangle_squared(p: Array, a: Array, b: Array, c: Array) -> float:
    """Squared distance of a point to a triangle: to its plane above the interior, otherwise to the nearest side."""
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
def _segment_squared(p: Array, a: Array, b: Array) -> float:
    """Squared distance of a point to a segment."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ex, ey, ez = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    length = dx * dx + dy * dy + dz * dz
    t = 0.0 if length == 0.0 else min(1.0, max(0.0, (ex * dx + ey * dy + ez * dz) / length))
    x, y, z = ex - t * dx, ey - t * dy, ez - t * dz
    return float(x * x + y * y + z * z)
