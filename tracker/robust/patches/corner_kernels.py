"""Compiled detection of corners on the structure for new patches."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.tracker.order_kernels import falling
from uavbench.tracker.robust.edges.hidden_line_kernels import TRIANGLES, Triangles
from uavbench.tracker.robust.patches.matches import HALF, SIDE
from uavbench.trajectories.geometry.ray_triangle import ray_triangle
from uavbench.trajectories.kernels.argument_types import named_tuple
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.pose import Array

Image = NDArray[np.uint8]
Indices = NDArray[np.int64]
CLIMB = 6
"""Largest distance of a corner from its start position along either axis, px."""


class KeepOut(NamedTuple):
    """Pixels (k, 2) around which, within radius_px, no corner is selected."""

    pixels: Array
    radius_px: float


KEEP_OUT = named_tuple(KeepOut, "f2! f0")


@compiled("u3 i0 i0", inner=True, allocates=False)
def corner_strength(image: Image, x: int, y: int) -> float:
    """Smaller eigenvalue of the gradients' second moments over a patch, per texel (Shi & Tomasi 1994)."""
    channel = 1 if image.shape[2] > 1 else 0
    half = int(HALF)
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(y - half + 1, y + half):
        for j in range(x - half + 1, x + half):
            gx = 0.5 * (float(image[i, j + 1, channel]) - float(image[i, j - 1, channel]))
            gy = 0.5 * (float(image[i + 1, j, channel]) - float(image[i - 1, j, channel]))
            xx += gx * gx
            xy += gx * gy
            yy += gy * gy
    texels = (SIDE - 2) * (SIDE - 2)
    return (0.5 * (xx + yy) - math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)) / texels


@compiled("u3 i2 keepout keepout f0 i0", keepout=KEEP_OUT)
def strong_pixels(image: Image, spots: Indices, edges: KeepOut, patches: KeepOut, least: float, most: int) -> Array:
    """Pixels (n, 2) of the strongest corners near start positions `spots` (s, 2), away from edges and patches.

    At most `most`, of a strength of at least `least`; patches.radius_px is also the least distance between corners.
    """
    known, apart_px = patches.pixels, patches.radius_px
    h, w = image.shape[0], image.shape[1]
    near = int(HALF) + 3
    strength = np.zeros(len(spots))
    pixels = np.empty((len(spots), 2), np.int64)
    for s in range(len(spots)):
        x, y = spots[s, 0], spots[s, 1]
        if not (near <= x < w - near and near <= y < h - near and far_from(x, y, known, len(known), apart_px - CLIMB)):
            continue
        best = corner_strength(image, x, y)
        for _ in range(CLIMB // 2):  # hill climbing
            bx, by = x, y
            for dx, dy in ((2, 0), (-2, 0), (0, 2), (0, -2)):
                if near <= x + dx < w - near and near <= y + dy < h - near:
                    value = corner_strength(image, x + dx, y + dy)
                    if value > best:
                        best, bx, by = value, x + dx, y + dy
            if bx == x and by == y:
                break
            x, y = bx, by
        strength[s], pixels[s, 0], pixels[s, 1] = best, x, y
    out = np.empty((most, 2))
    n = 0
    for s in falling(strength):
        if n == most or strength[s] < least:
            break
        x, y = float(pixels[s, 0]), float(pixels[s, 1])
        if (
            far_from(x, y, out, n, apart_px)
            and far_from(x, y, known, len(known), apart_px)
            and far_from(x, y, edges.pixels, len(edges.pixels), edges.radius_px)
        ):
            out[n, 0], out[n, 1] = x, y
            n += 1
    return out[:n].copy()


@compiled("f0 f0 f2 i0 f0", inner=True, allocates=False)
def far_from(x: float, y: float, others: Array, count: int, distance: float) -> bool:
    """Whether a pixel is at least `distance` from the first `count` of others (k, 2)."""
    for k in range(count):
        du, dv = others[k, 0] - x, others[k, 1] - y
        if du * du + dv * dv < distance * distance:
            return False
    return True


@compiled("f1 f1 triangles", inner=True, triangles=TRIANGLES)
def first_hit(eye: Array, ray: Array, triangles: Triangles) -> int:
    """The first face that a ray (3,) from the viewpoint `eye` hits, -1 for none."""
    corners, boxes, nodes = triangles.corners, triangles.boxes, triangles.nodes
    tiny = 1e-300
    i0, i1, i2 = 1.0 / (ray[0] + tiny), 1.0 / (ray[1] + tiny), 1.0 / (ray[2] + tiny)
    nearest, face = np.inf, -1
    stack = np.empty(64, np.int64)
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
        if near > far or far < 0.0 or near > nearest:
            continue
        if nodes[node, 0] >= 0:
            stack[depth], stack[depth + 1] = nodes[node, 0], nodes[node, 1]
            depth += 2
            continue
        first = -nodes[node, 0] - 1
        for m in range(first, first + nodes[node, 1]):
            along = ray_triangle(eye, ray, corners[m, 0], corners[m, 1], corners[m, 2])
            if 1e-6 < along < nearest:
                nearest, face = along, triangles.face[m]
    return face


@compiled("f1 f2 triangles", triangles=TRIANGLES)
def first_hits(eye: Array, rays: Array, triangles: Triangles) -> Indices:
    """The first face that each ray (n, 3) from the viewpoint `eye` hits, -1 for none."""
    faces = np.empty(len(rays), np.int64)
    for k in range(len(rays)):
        faces[k] = first_hit(eye, rays[k], triangles)
    return faces


@compiled("f1 f3 triangles", triangles=TRIANGLES)
def faces_of_all(eye: Array, rays: Array, triangles: Triangles) -> Indices:
    """The face (n,) that all m rays (n, m, 3) from the viewpoint `eye` hit first, -1 where they hit several or none."""
    faces = np.empty(len(rays), np.int64)
    for k in range(len(rays)):
        faces[k] = first_hit(eye, rays[k, 0], triangles)
        for m in range(1, rays.shape[1]):
            if faces[k] < 0 or first_hit(eye, rays[k, m], triangles) != faces[k]:
                faces[k] = -1
                break
    return faces
