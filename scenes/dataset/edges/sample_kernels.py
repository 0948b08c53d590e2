"""Kernels of samples along edges: clipping, sampling, and visibility.

Not shared with the trackers' `geometry_kernels.clip_segment`, whose rounding would change the bytes of edges/*.csv.
"""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

STEP_PX = 2.0
"""Distance of samples in the image, px."""
FEWEST = 3
"""Fewest samples on an edge in view."""
NEAR_M = 0.02
"""Near plane, metres: nearer parts of an edge are ignored."""
OCCLUDED_SHARE, OCCLUDED_M = 1.01, 1e-3
"""A point is visible up to this multiple of the depth of the pixels around it, plus metres."""


@compiled("f3 (f0 f0 f0 f0) (i0 i0) f2! i1!", allocates=False)
def clip_edges(ends: Any, intrinsics: Any, size: Any, shares: Any, counts: Any) -> int:
    """Clip edges (n, 2, 3) in the camera frame against the view frustum (Liang & Barsky 1984); returns the samples.

    intrinsics fx fy cx cy and size width height in px; shares (n, 2) along each edge, 0..1, at which it enters and
    leaves; counts (n,) of its samples, 0 outside.
    """
    fx, fy, cx, cy = intrinsics
    width, height = size
    total: int = 0
    for k in range(ends.shape[0]):
        enters, leaves = 0.0, 1.0
        x0, y0, z0 = ends[k, 0, 0], ends[k, 0, 1], ends[k, 0, 2]
        x1, y1, z1 = ends[k, 1, 0], ends[k, 1, 1], ends[k, 1, 2]
        u0, v0, u1, v1 = x0 * fx + z0 * cx, y0 * fy + z0 * cy, x1 * fx + z1 * cx, y1 * fy + z1 * cy
        for start, stop in (
            (z0 - NEAR_M, z1 - NEAR_M),
            (u0 + 0.5 * z0, u1 + 0.5 * z1),
            ((width - 0.5) * z0 - u0, (width - 0.5) * z1 - u1),
            (v0 + 0.5 * z0, v1 + 0.5 * z1),
            ((height - 0.5) * z0 - v0, (height - 0.5) * z1 - v1),
        ):
            if start < 0 and stop >= 0:
                enters = max(enters, start / (start - stop))
            elif start >= 0 and stop < 0:
                leaves = min(leaves, start / (start - stop))
            elif start < 0 and stop < 0:
                leaves = 0.0
        shares[k, 0], shares[k, 1], counts[k] = enters, leaves, 0
        if enters < leaves:
            ax, ay = _image_place(_along(x0, x1, enters), _along(y0, y1, enters), _along(z0, z1, enters), intrinsics)
            bx, by = _image_place(_along(x0, x1, leaves), _along(y0, y1, leaves), _along(z0, z1, leaves), intrinsics)
            length = np.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
            counts[k] = max(int(np.ceil(length / STEP_PX)) + 1, FEWEST)
        total += counts[k]
    return total


@compiled
def _along(start: float, stop: float, share: float) -> float:
    """The place at a share of the way."""
    return start + share * (stop - start)


@compiled
def _image_place(x: float, y: float, z: float, intrinsics: Any) -> tuple[float, float]:
    """Pixel of a point in the camera frame."""
    fx, fy, cx, cy = intrinsics
    return x / z * fx + cx, y / z * fy + cy


@compiled("f3 f2 i1 i1! f1! f2!", allocates=False)
def sample_edges(ends: Any, shares: Any, counts: Any, which: Any, share: Any, points: Any) -> None:
    """Samples (m,), evenly spaced in the image, of edges clipped by `clip_edges`.

    which: the edge; share: the place along it (0..1); points (m, 3) in the camera frame.
    """
    i = 0
    for k in range(ends.shape[0]):
        begin, end = shares[k, 0], shares[k, 1]
        near, far = _along(ends[k, 0, 2], ends[k, 1, 2], begin), _along(ends[k, 0, 2], ends[k, 1, 2], end)
        for n in range(counts[k]):
            even = n / (counts[k] - 1)
            along = even * near / (even * near + (1 - even) * far)  # even steps in the image are uneven in space
            which[i], share[i] = k, begin + along * (end - begin)
            for axis in range(3):
                start = _along(ends[k, 0, axis], ends[k, 1, axis], begin)
                stop = _along(ends[k, 0, axis], ends[k, 1, axis], end)
                points[i, axis] = start + along * (stop - start)
            i += 1


@compiled("f2 (f0 f0 f0 f0) f2!", allocates=False)
def project(points: Any, intrinsics: Any, pixels: Any) -> None:
    """Pixels (m, 2) of points (m, 3) in the frame of a camera without distortion."""
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1] = _image_place(points[i, 0], points[i, 1], points[i, 2], intrinsics)


@compiled("f2 (f0 f0 f0 f0) s2 f2 (i0 i0) b1!", allocates=False)
def see(points: Any, intrinsics: Any, depth: Any, pixels: Any, size: Any, seen: Any) -> None:
    """Whether points (m, 3) are not occluded in the pinhole's view, and their pixels (m, 2) inside the image.

    intrinsics: those of the pinhole; depth (h, w): of its view in metres, 0 for the background; size: width and height
    of the image in px.
    """
    width, height = size
    for i in range(points.shape[0]):
        inside = -0.5 <= pixels[i, 0] <= width - 0.5 and -0.5 <= pixels[i, 1] <= height - 0.5
        u, v = _image_place(points[i, 0], points[i, 1], points[i, 2], intrinsics)
        seen[i] = inside and _unoccluded(points[i, 2], depth, int(np.rint(u)), int(np.rint(v)))


@compiled
def _unoccluded(z: float, depth: Any, column: int, row: int) -> bool:
    """Whether a point at a depth is not behind a pixel, clipped to the image, or not behind one of those around it."""
    h, w = depth.shape
    column, row = min(max(column, 0), w - 1), min(max(row, 0), h - 1)
    nearest = farthest = depth[row, column]
    if _before(z, nearest):
        return True
    left, right = max(column - 1, 0), min(column + 1, w - 1)
    for i in range(max(row - 1, 0), min(row + 2, h)):
        a, b, c = depth[i, left], depth[i, column], depth[i, right]
        nearest, farthest = min(nearest, a, b, c), max(farthest, a, b, c)
    return _before(z, nearest) if nearest <= 0 else _before(z, farthest)


@compiled
def _before(z: float, depth: Any) -> bool:
    """Whether a point is not behind what a pixel shows; depth 0 is background."""
    return bool(depth <= 0 or z <= np.float32(np.float32(OCCLUDED_SHARE) * depth) + np.float32(OCCLUDED_M))


@compiled("i1 f1 f2 b1 f1 f2!", allocates=False)
def join_seen(which: Any, share: Any, pixels: Any, seen: Any, contrast: Any, parts: Any) -> int:
    """Runs of at least two visible samples of one edge, as rows (k, 7) of EDGE_COLUMNS; returns how many.

    which, share, seen and contrast (n,) and pixels (n, 2): the samples; parts has room for n / 2 rows.
    """
    count, total, begin, before = 0, 0.0, 0, 0.0
    for i in range(which.size):
        if i == 0 or which[i] != which[i - 1] or not seen[i - 1]:
            begin, before = i, total
        total += contrast[i]
        goes_on = i + 1 < which.size and which[i + 1] == which[i] and seen[i + 1]
        if seen[i] and not goes_on and i > begin:
            row = parts[count]
            row[0] = which[i]
            row[1], row[2], row[3], row[4] = pixels[begin, 0], pixels[begin, 1], pixels[i, 0], pixels[i, 1]
            row[5], row[6] = share[i] - share[begin], (total - before) / (i + 1 - begin)
            count += 1
    return count
