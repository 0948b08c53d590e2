"""Kernel that traces the pixels of a camera to the facets that were rendered around them."""

from typing import Any

import numpy as np

from uavbench.trajectories.kernels.compiled import compiled

ON_BORDER = 1e-9
"""Tolerance of barycentric coordinates for points on the border of a triangle."""
FARTHEST_BESIDE = 0.1
"""Relative depth by which a plane may differ between a ray beside its facet and the rendered pixel's centre."""


@compiled
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Cross product of two vectors."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled
def plane_share(normal: Any, offset: float, eye: Any, x: float, y: float, z: float) -> float:
    """Ray parameter at which a ray (x, y, z) from the eye meets a plane; inf where it does not."""
    share = (offset - (normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2])) / (
        normal[0] * x + normal[1] * y + normal[2] * z
    )
    return share if share > 0 else np.inf  # also for NaN


@compiled
def is_inside(corners: Any, x: float, y: float, z: float) -> bool:
    """Whether a point in the plane of a triangle (3, 3) lies in the triangle, by its barycentric coordinates."""
    ax, ay, az = corners[0, 0], corners[0, 1], corners[0, 2]
    ux, uy, uz = corners[1, 0] - ax, corners[1, 1] - ay, corners[1, 2] - az
    vx, vy, vz = corners[2, 0] - ax, corners[2, 1] - ay, corners[2, 2] - az
    nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
    size = max(nx * nx + ny * ny + nz * nz, 1e-300)
    px, py, pz = x - ax, y - ay, z - az
    qx, qy, qz = cross(px, py, pz, vx, vy, vz)
    second = (qx * nx + qy * ny + qz * nz) / size
    qx, qy, qz = cross(ux, uy, uz, px, py, pz)
    third = (qx * nx + qy * ny + qz * nz) / size
    return bool(second >= -ON_BORDER and third >= -ON_BORDER and 1.0 - second - third >= -ON_BORDER)


@compiled
def turned(rotation: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Product of a rotation (3, 3) and a vector."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@compiled("i2 (i2 i2) (i2 i0) (f2 f1 f3) (f1 f2 f2 f2) i1! f1!", allocates=False)
def trace(seen: Any, pixels: Any, tried: Any, planes: Any, rays: Any, rows: Any, depths: Any) -> None:
    """Facet and ray parameter of each pixel: the nearest of the facets rendered around it that its ray passes through.

    seen (h, w): rendered facets, -1 for none. pixels: column and row (k, 2) of the rendered pixel next to each pixel,
    and of the one to which steps are added. tried: steps (m, 2), and the number of the first ones that are tried for
    every pixel; the others are left out where those show one facet, and the ray meets it. planes: normals, offsets,
    corners. rays: their origin in the world, the rotation (3, 3) from the camera to the world, and directions (k, 3) in
    the camera's frame through the pixels, and through the centres of those rendered next to them. A ray that misses all
    facets has the plane of the one rendered next to it; where that plane is too slanted, its depth in the centre.
    Without a facet rows are -1, and depths are left.
    """
    next_to, base = pixels
    steps, sure = tried
    normals, offsets, corners = planes
    eye, rotation, through, through_centre = rays
    h, w = seen.shape
    for k in range(through.shape[0]):
        x, y, z = turned(rotation, through[k, 0], through[k, 1], through[k, 2])
        centre = seen[next_to[k, 1], next_to[k, 0]]
        best, row, last, alike = np.inf, np.int64(-1), np.int64(-1), True
        for number in range(steps.shape[0]):
            if number == sure and alike and (centre < 0 or best < np.inf):
                break
            i = min(max(base[k, 1] + steps[number, 1], 0), h - 1)
            j = min(max(base[k, 0] + steps[number, 0], 0), w - 1)
            facet = seen[i, j]
            is_new, last = facet != last, facet
            alike = alike and (number == 0 or not is_new)
            if facet < 0 or not is_new:
                continue
            share = plane_share(normals[facet], offsets[facet], eye, x, y, z)
            if share < best and is_inside(corners[facet], eye[0] + share * x, eye[1] + share * y, eye[2] + share * z):
                best, row = share, facet
        if row < 0 and centre >= 0:
            row = centre
            best = plane_share(normals[row], offsets[row], eye, x, y, z)
            x, y, z = turned(rotation, through_centre[k, 0], through_centre[k, 1], through_centre[k, 2])
            there = plane_share(normals[row], offsets[row], eye, x, y, z)
            if not abs(best - there) <= FARTHEST_BESIDE * there:
                best = there
        rows[k] = row
        if row >= 0:
            depths[k] = best
