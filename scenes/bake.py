"""Light that does not change, worked out once by rays: how open each vertex is, how much of the lamp it sees."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from scenes.parts import Light, Part
from trajectories.pose import Array
from trajectories.surroundings import Surroundings

OFFSET_M = 1e-4


def bake(
    parts: tuple[Part, ...], occluder: Surroundings, light: Light, reach_m: float, rays: int = 48, lamp_rays: int = 24
) -> tuple[Part, ...]:
    """The parts with tints darkened by what stands near them.

    Ambient occlusion (Zhukov et al. 1998) within reach_m by cosine-weighted rays; where the light throws no
    shadow map, also the share of a round lamp seen, whose radius makes shadows of width softness_m at reach_m.
    """
    return tuple(_bake_part(part, occluder, light, reach_m, rays, lamp_rays) for part in parts)


def _bake_part(part: Part, occluder: Surroundings, light: Light, reach_m: float, rays: int, lamp_rays: int) -> Part:
    part = smooth_corners(part)
    assert part.normals is not None
    low, high = occluder.bounds
    near = ((part.vertices > low - reach_m) & (part.vertices < high + reach_m)).all(axis=1)
    tint = np.ones((len(part.vertices), 4)) if part.tint is None else part.tint.copy()
    at = part.vertices[near] + part.normals[near] * max(OFFSET_M, reach_m * 1e-4)
    open_share = _open(at, _about(part.normals[near], _hemisphere(rays)), occluder, reach_m)
    seen = np.column_stack([open_share, open_share, open_share, np.ones(len(at))])
    if not light.shadow_map:
        to_lamp = np.array(light.to_lamp) / np.linalg.norm(light.to_lamp)
        disc = _hemisphere(lamp_rays)
        disc[:, :2] *= light.softness_m / reach_m
        disc[:, 2] = 1.0
        directions = _about(np.broadcast_to(to_lamp, at.shape), disc / np.linalg.norm(disc, axis=1, keepdims=True))
        seen[:, 3] = _open(at, directions, occluder, np.inf)
    tint[near] *= _from_outside(at, seen, occluder)
    return replace(part, tint=tint)


def _from_outside(at: Array, seen: Array, occluder: Surroundings) -> Array:
    """`seen` (n, 4) of points (n, 3); points inside the occluder take that of the nearest one outside.

    So the dark under a thing does not leak out from below it.
    """
    inside = occluder.inside(at) if len(at) else np.zeros(0, dtype=bool)
    if inside.any() and not inside.all():
        nearest = cKDTree(at[~inside]).query(at[inside])[1]
        seen[inside] = seen[~inside][nearest]
    return seen


def smooth_corners(part: Part) -> Part:
    """The part with a normal at each vertex; without normals, each triangle gets corners of its own."""
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


def _open(at: Array, directions: Array, occluder: Surroundings, reach_m: float) -> Array:
    """Share (n,) of directions (n, k, 3) from points (n, 3) that meet nothing within reach_m."""
    n, k, _ = directions.shape
    hit = occluder.ray(np.repeat(at, k, axis=0), directions.reshape(-1, 3)).reshape(n, k)
    return np.asarray((~(hit < reach_m)).mean(axis=1)) if n else np.zeros(0)


def _hemisphere(count: int) -> Array:
    """Cosine-weighted directions (count, 3) about +z: a Fibonacci spiral on the disc, lifted."""
    i = np.arange(count) + 0.5
    radius, angle = np.sqrt(i / count), i * np.pi * (3 - np.sqrt(5))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - i / count)])


def _about(axes: Array, directions: Array) -> Array:
    """Directions (n, k, 3): those about +z (k, 3) turned about each axis (n, 3)."""
    helper = np.where(np.abs(axes[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    x = np.cross(helper, axes)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axes, x)
    return np.asarray(np.einsum("kc,ncd->nkd", directions, np.stack([x, y, axes], axis=1)))
