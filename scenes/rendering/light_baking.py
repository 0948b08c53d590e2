"""Light baking by ray casting: ambient occlusion per vertex, and the visible fraction of the lamp."""

from dataclasses import replace

import cv2
import numpy as np

from uavbench.scenes.renderables import Light, Part, Texture
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array

OFFSET_M = 1e-4
GRID = 96
BOUNCED = 0.35
"""Fraction of the ambient light that reaches a fully occluded point by interreflection."""
TEXTURE_PX = 2048


def bake(
    parts: tuple[Part, ...], occluder: ObstacleMesh, light: Light, reach_m: float, rays: int = 48, lamp_rays: int = 24
) -> tuple[Part, ...]:
    """Parts with ambient occlusion baked into their tints.

    Ambient occlusion (Zhukov et al. 1998) by cosine-weighted rays up to reach_m metres; without a shadow map, also the
    visible fraction of a disc-shaped lamp, whose penumbra is softness_m wide at a distance of reach_m.
    """
    return tuple(_bake_part(part, occluder, light, reach_m, rays, lamp_rays) for part in parts)


def _bake_part(part: Part, occluder: ObstacleMesh, light: Light, reach_m: float, rays: int, lamp_rays: int) -> Part:
    if part.lightmap:
        return _bake_texture(part, occluder, light, reach_m, rays, lamp_rays)
    part = smooth_corners(part)
    assert part.normals is not None
    low, high = occluder.bounds
    near = ((part.vertices > low - reach_m) & (part.vertices < high + reach_m)).all(axis=1)
    tint = np.ones((len(part.vertices), 4)) if part.tint is None else part.tint.copy()
    tint[near] *= _seen(part.vertices[near], part.normals[near], occluder, light, reach_m, rays, lamp_rays)
    return replace(part, tint=tint)


def _bake_texture(part: Part, occluder: ObstacleMesh, light: Light, reach_m: float, rays: int, lamp_rays: int) -> Part:
    """Parallelogram with a lightmap: its resampled texture times the ratio of occluded to unoccluded light."""
    assert part.uv is not None and part.texture is not None
    corner, u, v = part.vertices[0], part.vertices[1] - part.vertices[0], part.vertices[3] - part.vertices[0]
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    s, t = np.meshgrid((np.arange(GRID) + 0.5) / GRID, (np.arange(GRID) + 0.5) / GRID)
    at = corner + s.reshape(-1, 1) * u + t.reshape(-1, 1) * v
    seen = _seen(at, np.broadcast_to(normal, at.shape), occluder, light, reach_m, rays, lamp_rays)
    to_lamp = np.array(light.to_lamp) / np.linalg.norm(light.to_lamp)
    ambient = float(np.mean((1 + normal[2]) / 2 * np.array(light.above) + (1 - normal[2]) / 2 * np.array(light.below)))
    direct = float(np.mean(light.lamp)) * max(float(normal @ to_lamp), 0.0)
    ratio = seen[:, 0] * (ambient + direct * seen[:, 3]) / (ambient + direct)
    shade = cv2.resize(np.sqrt(ratio).reshape(GRID, GRID).astype(np.float32)[::-1], (TEXTURE_PX, TEXTURE_PX))
    lit = np.asarray(cv2.multiply(_resampled(part), cv2.merge([shade] * 3), dtype=cv2.CV_8U), dtype=np.uint8)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    inset = (corners * (TEXTURE_PX - 1) + 0.5) / TEXTURE_PX
    return replace(part, texture=lit, uv=inset, tint=None, normals=np.broadcast_to(normal, (4, 3)))


def _resampled(part: Part) -> Texture:
    """Texture (TEXTURE_PX, TEXTURE_PX, 3) resampled over a parallelogram, first side to the right, last one upwards."""
    assert part.uv is not None and part.texture is not None
    h, w = part.texture.shape[:2]
    size = np.array([w, -h])
    step_x, step_y = (part.uv[1] - part.uv[0]) * size / TEXTURE_PX, (part.uv[0] - part.uv[3]) * size / TEXTURE_PX
    start = part.uv[3] * size + (step_x + step_y) / 2 - 0.5
    matrix = np.column_stack([step_x, step_y, start])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    out = cv2.warpAffine(
        part.texture[..., :3], matrix, (TEXTURE_PX, TEXTURE_PX), flags=flags, borderMode=cv2.BORDER_WRAP
    )
    return np.asarray(out, dtype=np.uint8)


def _seen(
    points: Array, normals: Array, occluder: ObstacleMesh, light: Light, reach_m: float, rays: int, lamp_rays: int
) -> Array:
    """Factors (n, 4) at surface points (n, 3): ambient light for R, G and B, and the visible fraction of the lamp."""
    alike = np.rint(np.hstack([points / OFFSET_M, normals * 1e4])).astype(np.int64)
    _, first, same = np.unique(alike, axis=0, return_index=True, return_inverse=True)
    points, normals = points[first], normals[first]
    at = points + normals * max(OFFSET_M, reach_m * 1e-4)
    seen = np.ones((len(at), 4))
    open_share = _open(at, _about(normals, _hemisphere(rays)), occluder, reach_m)
    seen[:, :3] = BOUNCED + (1 - BOUNCED) * open_share[:, None]
    if not light.shadow_map:
        to_lamp = np.array(light.to_lamp) / np.linalg.norm(light.to_lamp)
        disc = _hemisphere(lamp_rays)
        disc[:, :2] *= light.softness_m / reach_m
        disc[:, 2] = 1.0
        directions = _about(np.broadcast_to(to_lamp, at.shape), disc / np.linalg.norm(disc, axis=1, keepdims=True))
        seen[:, 3] = _open(at, directions, occluder, np.inf)
    return _from_outside(at, seen, occluder)[same.reshape(-1)]


def _from_outside(at: Array, seen: Array, occluder: ObstacleMesh) -> Array:
    """Factors (n, 4) with those of points (n, 3) inside the occluder replaced by those of the nearest point outside.

    This keeps interpolation from leaking darkness out from under an object.
    """
    inside = occluder.inside(at) if len(at) else np.zeros(0, dtype=bool)
    if inside.any() and not inside.all():
        from scipy.spatial import cKDTree  # lazy: it takes 0.3 s, and trackers import this module too

        nearest = cKDTree(at[~inside]).query(at[inside])[1]
        seen[inside] = seen[~inside][nearest]
    return seen


def smooth_corners(part: Part) -> Part:
    """The part with a normal per vertex; without normals, vertices are duplicated per triangle (flat shading)."""
    if part.normals is not None:
        return part
    flat = part.triangles.reshape(-1)
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return replace(
        part,
        vertices=part.vertices[flat],
        triangles=np.arange(len(flat)).reshape(-1, 3),
        normals=np.repeat(normals, 3, axis=0),
        uv=None if part.uv is None else part.uv[flat],
        tint=None if part.tint is None else part.tint[flat],
    )


def _open(at: Array, directions: Array, occluder: ObstacleMesh, reach_m: float) -> Array:
    """Fraction (n,) of directions (n, k, 3) from points (n, 3) that are unoccluded up to reach_m metres."""
    return 1 - occluder.blocked(at, directions, reach_m).mean(axis=1) if len(at) else np.zeros(0)


def _hemisphere(count: int) -> Array:
    """Cosine-weighted directions (count, 3) about +z: a Fibonacci spiral on the disc, projected to the hemisphere."""
    i = np.arange(count) + 0.5
    radius, angle = np.sqrt(i / count), i * np.pi * (3 - np.sqrt(5))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - i / count)])


def _about(axes: Array, directions: Array) -> Array:
    """Directions (n, k, 3): directions (k, 3) about +z rotated to each axis (n, 3)."""
    helper = np.where(np.abs(axes[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(helper, axes)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axes, x)
    return np.asarray(np.einsum("kc,ncd->nkd", directions, np.stack([x, y, axes], axis=1)))
