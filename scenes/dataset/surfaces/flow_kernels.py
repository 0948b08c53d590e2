"""Kernels of the motion, occlusion and normals of the surfaces that pixels show, and of the numbers in their files."""

from typing import Any

import numpy as np

from uavbench.scenes.dataset.surfaces.surface_files import (
    FLOW_UNITS_PER_PX,
    FLOW_ZERO,
    HIDDEN,
    LARGEST_FLOW_PX,
    NORMAL_UNITS,
    OUTSIDE,
    SEEN,
    UNKNOWN,
)
from uavbench.scenes.dataset.surfaces.trace_kernels import plane_share, turned
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.kernels.lens import project

BEFORE = 1e-3
"""Relative depth difference above which a nearer surface occludes a point."""
LEAST_SLOPE = 1e-6
"""Cosine of the angle to the optical axis from which on a point is before the camera."""
DOUBTFUL = 4
"""Value of the occlusion of points too far off-axis for the lens to be known as one-to-one there."""


@compiled("(f2 f1 i1) i1 f3 f0 f2! u1!", allocates=False)
def carry(shown: Any, mover_of: Any, motions: Any, widest: float, moved: Any, occlusion: Any) -> int:
    """Surface points (k, 3) of pixels in the frame of a later camera, for the sky directions; returns those in doubt.

    shown: rays (k, 3), depths along them, inf for the sky and NaN for nothing, and facets (k,), any for the sky.
    mover_of (n,): the row of each facet in motions (m, 3, 4) from the camera to the later one; row 0 is of what rests.
    widest: tangent of the angle to the optical axis up to which the lens is one-to-one. occlusion (k,) becomes UNKNOWN
    where there is no point before the camera, DOUBTFUL beyond that angle, SEEN elsewhere.
    """
    rays, depths, rows = shown
    doubtful: int = 0
    for k in range(depths.size):
        occlusion[k] = UNKNOWN
        depth = depths[k]
        if np.isnan(depth):
            continue
        motion, scale, near = 0, 1.0, 0.0
        if depth < np.inf:
            motion, scale, near = mover_of[rows[k]], depth, 1.0
        x, y, z = scale * rays[k, 0], scale * rays[k, 1], scale * rays[k, 2]
        a, b, c = motions[motion, 0], motions[motion, 1], motions[motion, 2]
        u = a[0] * x + a[1] * y + a[2] * z + near * a[3]
        v = b[0] * x + b[1] * y + b[2] * z + near * b[3]
        w = c[0] * x + c[1] * y + c[2] * z + near * c[3]
        moved[k, 0], moved[k, 1], moved[k, 2] = u, v, w
        aside2 = u * u + v * v
        if not (w > 0 and w * w > LEAST_SLOPE * LEAST_SLOPE * (aside2 + w * w)):
            continue
        if aside2 > widest * widest * w * w:
            occlusion[k] = DOUBTFUL
            doubtful += 1
        else:
            occlusion[k] = SEEN
    return doubtful


@compiled("(f2 f1 i1) f2 (f1 (f0 f0 f0 f0)) (i2 f2 f1 f1 f2) f3! u2!", allocates=False)
def compare(shown: Any, moved: Any, lens: Any, later: Any, flow: Any, occlusion: Any) -> None:
    """Flow (h, w, 2) in px to points moved by `carry`, NaN where it is not known, and the final occlusion (h, w).

    lens: array of the camera, and fx fy cx cy of the pinhole that was rendered. later: facets in the later image
    (h', w'), normals and offsets of their planes, and the later camera in the world: place (3,), rotation (3, 3). A
    point is HIDDEN where all four rendered pixels around it show other facets, BEFORE it.
    """
    _, depths, rows = shown
    cam, pinhole = lens
    h, w = occlusion.shape
    for i in range(h):
        for j in range(w):
            k = i * w + j
            flow[i, j, 0] = flow[i, j, 1] = np.nan
            if occlusion[i, j] == UNKNOWN:
                continue
            x, y, z = moved[k, 0], moved[k, 1], moved[k, 2]
            u, v = project(x, y, z, cam)
            du, dv = u - j, v - i
            if not (abs(du) < LARGEST_FLOW_PX and abs(dv) < LARGEST_FLOW_PX):
                occlusion[i, j] = UNKNOWN
                continue
            flow[i, j, 0], flow[i, j, 1] = du, dv
            if not (-0.5 <= u <= w - 0.5 and -0.5 <= v <= h - 0.5):
                occlusion[i, j] = OUTSIDE
            elif _is_hidden(x, y, z, rows[k], depths[k] < np.inf, pinhole, later):
                occlusion[i, j] = HIDDEN
            else:
                occlusion[i, j] = SEEN


@compiled
def _is_hidden(x: float, y: float, z: float, row: int, is_near: bool, pinhole: Any, later: Any) -> bool:
    """Whether all four rendered pixels around a point in the later camera's frame show facets before it."""
    fx, fy, cx, cy = pinhole
    left, top = int(np.floor(x / z * fx + cx)), int(np.floor(y / z * fy + cy))
    # of most points the first of the four shows the facet; asked here, without the loop, it takes a quarter of the time
    return _facet(later[0], left, top) != row and _is_behind(x, y, z, row, is_near, (left, top), later)


@compiled
def _facet(seen: Any, column: int, row: int) -> int:
    """The facet that a pixel shows, or the nearest one of the image."""
    return int(seen[min(max(row, 0), seen.shape[0] - 1), min(max(column, 0), seen.shape[1] - 1)])


@compiled
def _is_behind(x: float, y: float, z: float, row: int, is_near: bool, corner: Any, later: Any) -> bool:
    """Whether the four pixels from a corner to the right and below show facets other than a point's, before it."""
    seen, normals, offsets, eye, rotation = later
    a, b, c = turned(rotation, x, y, z)
    for step in range(4):
        other = _facet(seen, corner[0] + (step & 1), corner[1] + (step >> 1))
        if other < 0 or other == row:
            return False
        if is_near and not plane_share(normals[other], offsets[other], eye, a, b, c) < 1 - BEFORE:
            return False
    return True


@compiled("i1 f2 f2 f2 f2!", allocates=False)
def face(rows: Any, normals: Any, rotation: Any, rays: Any, out: Any) -> None:
    """Normals (k, 3) of the facets of pixels, turned by a rotation and towards their rays' origin; NaN for row -1."""
    for k in range(rows.size):
        row = rows[k]
        if row < 0:
            out[k, 0] = out[k, 1] = out[k, 2] = np.nan
            continue
        x, y, z = turned(rotation, normals[row, 0], normals[row, 1], normals[row, 2])
        away = x * rays[k, 0] + y * rays[k, 1] + z * rays[k, 2] > 0
        out[k, 0], out[k, 1], out[k, 2] = (-x, -y, -z) if away else (x, y, z)


@compiled("f2 h2!", allocates=False)
def normal_codes(normals: Any, out: Any) -> None:
    """Numbers (k, 3) z y x in the files of normals (k, 3)."""
    for k in range(normals.shape[0]):
        known = not np.isnan(normals[k, 0])
        for axis in range(3):
            code = np.rint((normals[k, axis] + 1) / 2 * NORMAL_UNITS) if known else 0.0
            out[k, 2 - axis] = np.uint16(code)


@compiled("f2 h2!", allocates=False)
def flow_codes(flow: Any, out: Any) -> None:
    """Numbers (k, 3) known v u in the files of flow (k, 2) in px."""
    for k in range(flow.shape[0]):
        known = not np.isnan(flow[k, 0])
        out[k, 0] = np.uint16(known)
        for axis in range(2):
            code = np.rint(flow[k, axis] * FLOW_UNITS_PER_PX) + FLOW_ZERO if known else 0.0
            out[k, 2 - axis] = np.uint16(code)
