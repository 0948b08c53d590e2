"""Closed solids from which structures are built, and the texture mapping of their faces."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.meshes import box
from uavbench.scenes.renderables import Part
from uavbench.scenes.structure import Indices, Structure
from uavbench.trajectories.pose import Array

SLENDER_M = 0.25
"""Triangles of less height than this, metres, are not subdivided: shading gradients on them are not visible."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh of one material: vertices (n, 3) in metres, triangles (m, 3); deviations refer to its `name`."""

    vertices: Array
    triangles: Indices
    material: Material
    name: str = ""


def block(low: Iterable[float], high: Iterable[float], material: Material, name: str = "") -> Solid:
    """Axis-aligned box between its lowest and highest corners (3,), metres."""
    return Solid(*box(low, high), material, name)


def prism(profile: Array, start: Iterable[float], end: Iterable[float], material: Material, name: str = "") -> Solid:
    """Prism of a simple, counter-clockwise polygon (n, 2) swept from start (3,) to end (3,), metres.

    The polygon's first axis is horizontal, to the left of the sweep direction, and its second completes a right-handed
    frame (upwards for a horizontal sweep). For a vertical sweep the first axis is y.
    """
    a, b = np.array(list(start), dtype=np.float64), np.array(list(end), dtype=np.float64)
    along = (b - a) / np.linalg.norm(b - a)
    left = np.cross([0.0, 0.0, 1.0], along) if abs(along[2]) < 1 - 1e-9 else np.array([0.0, 1.0, 0.0])
    left /= np.linalg.norm(left)
    up = np.cross(along, left)
    offsets = profile[:, :1] * left + profile[:, 1:] * up
    n = len(profile)
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.column_stack([i, n + i, n + j]), np.column_stack([i, n + j, j])])
    caps = ear_clip(profile)
    return Solid(np.concatenate([a + offsets, b + offsets]), _outward(sides, caps, n), material, name)


def _outward(sides: Indices, caps: Indices, n: int) -> Indices:
    """Triangles of a prism, counter-clockwise from outside: left x up = along, so the far cap keeps its orientation."""
    return np.concatenate([sides[:, ::-1], caps[:, ::-1], caps + n]).astype(np.int64)


def ear_clip(polygon: Array) -> Indices:
    """Ear-clipping triangulation (n - 2, 3) of a simple counter-clockwise polygon (n, 2) (Meisters 1975).

    ValueError when the polygon is not simple or not counter-clockwise. Implemented here since trimesh's triangulation
    needs earcut or triangle, which it does not install, and another triangulation would change the rendered datasets.
    """
    left = list(range(len(polygon)))
    out: list[list[int]] = []

    def turn(a: int, b: int, c: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = polygon[a], polygon[b], polygon[c]
        return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))

    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            others = [p for p in left if p not in (a, b, c)]
            inside = any(turn(a, b, p) >= 0 and turn(b, c, p) >= 0 and turn(c, a, p) >= 0 for p in others)
            if turn(a, b, c) > 0 and not inside:
                out.append([a, b, c])
                left.pop(k)
                break
        else:
            raise ValueError("the polygon is not simple or not counter-clockwise")
    return np.array([*out, left], dtype=np.int64)


def polygon_triangles(corners: Array) -> Indices:
    """Triangles (n - 2, 3) of a simple planar polygon (n, 3), of the same orientation; ValueError for another one."""
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    u = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    return ear_clip(np.column_stack([corners @ u, corners @ np.cross(normal, u)]))


def circle(radius: float, sides: int) -> Array:
    """Regular polygon (sides, 2) about the origin, of the same area as a circle of this radius."""
    angle = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    r = radius * np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    return np.asarray(r * np.column_stack([np.cos(angle), np.sin(angle)]))


def covered(solid: Solid, instance: int = 1, longest_m: float = 3.0) -> Part:
    """The solid as a textured part.

    Triangles are bisected until no side exceeds longest_m metres; texture coordinates are metres along the horizontal
    and the slope of each face (x and y for level faces), over the tile size of the material.
    """
    points = solid.vertices[solid.triangles]
    points = _cut(points, longest_m)
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    level = np.abs(normals[:, 2]) > 0.9
    u = np.where(level[:, None], [[1.0, 0.0, 0.0]], np.cross([0.0, 0.0, 1.0], normals))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    uv = np.stack([np.einsum("tpc,tc->tp", points, u), np.einsum("tpc,tc->tp", points, v)], axis=-1)
    return Part(
        vertices=points.reshape(-1, 3),
        triangles=np.arange(3 * len(points)).reshape(-1, 3),
        normals=np.repeat(normals, 3, axis=0),
        uv=uv.reshape(-1, 2) / np.array(solid.material.tile_m),
        texture=solid.material.texture,
        roughness=solid.material.roughness,
        instance=instance,
        name=solid.name,
    )


def cover_all(solids: Iterable[Solid], instance: int = 1, longest_m: float = 3.0) -> tuple[Part, ...]:
    """Textured parts of all solids, as `covered`."""
    return tuple(covered(solid, instance, longest_m) for solid in solids)


def structure_of(solids: Iterable[Solid]) -> Structure:
    """Structure of solids that may touch but share no faces: each solid keeps all of its crease edges."""
    several = [Structure.from_mesh(s.vertices, s.triangles) for s in solids]
    points = np.cumsum([0] + [len(s.vertices) for s in several])
    faces = np.cumsum([0] + [len(s.face_normals) for s in several])
    return Structure(
        np.concatenate([s.vertices for s in several]),
        np.concatenate([s.triangles + n for s, n in zip(several, points[:-1], strict=True)]),
        np.concatenate([s.triangle_face + n for s, n in zip(several, faces[:-1], strict=True)]),
        np.concatenate([s.face_normals for s in several]),
        np.concatenate([s.edges + n for s, n in zip(several, points[:-1], strict=True)]),
        np.concatenate(
            [np.where(s.edge_faces >= 0, s.edge_faces + n, -1) for s, n in zip(several, faces[:-1], strict=True)]
        ),
    )


def cells(xs: Array, ys: Array, zs: Array, filled: NDArray[np.bool_], material: Material, name: str = "") -> Solid:
    """Closed surface of the filled cells (nx, ny, nz) of a grid with lines xs (nx + 1,), ys, zs, metres."""
    shape = (len(xs), len(ys), len(zs))
    number = np.arange(np.prod(shape)).reshape(shape)
    triangles = []
    for axis in range(3):
        other = [(axis + 1) % 3, (axis + 2) % 3]
        padded = np.pad(filled, [(1, 1) if k == axis else (0, 0) for k in range(3)])
        change = np.diff(padded.astype(np.int8), axis=axis)
        for sign in (1, -1):
            at = np.argwhere(change == -sign)
            corner = [number[tuple((at + step).T)] for step in _square(*other)]
            a, b, c, d = corner if sign > 0 else corner[::-1]
            triangles += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    grid = np.stack(np.meshgrid(xs, ys, zs, indexing="ij"), axis=-1).reshape(-1, 3)
    used, index = np.unique(np.concatenate(triangles), return_inverse=True)
    return Solid(grid[used], index.reshape(-1, 3), material, name)


def _square(u: int, v: int) -> Indices:
    """Index offsets (4, 3) of the corners of a cell face, counter-clockwise about u x v."""
    steps = np.zeros((4, 3), dtype=np.int64)
    steps[1:3, u] = 1
    steps[2:4, v] = 1
    return steps


def picture(origin: Array, u: Array, v: Array, material: Material, instance: int = 1, inset: float = 0.002) -> Part:
    """Rectangle (origin, sides u and v (3,), metres) that shows the texture once, cropped by `inset` on each side."""
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    return Part(
        vertices=np.array([origin, origin + u, origin + u + v, origin + v]),
        triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        normals=np.tile(normal, (4, 1)),
        uv=np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * (1 - 2 * inset) + inset,
        texture=material.texture,
        roughness=material.roughness,
        instance=instance,
    )


def moved(part: Part, rotation: Array, translation: Array) -> Part:
    """The part with its vertices rotated by rotation (3, 3), then translated by translation (3,), metres."""
    return replace(
        part,
        vertices=part.vertices @ rotation.T + translation,
        normals=None if part.normals is None else part.normals @ rotation.T,
    )


def subdivided(part: Part, longest_m: float, below_m: float) -> Part:
    """The part with triangles that reach below z = below_m bisected until no side exceeds longest_m, metres."""
    given = [name for name in ("normals", "uv", "tint") if getattr(part, name) is not None]
    columns = np.hstack([part.vertices, *(getattr(part, name) for name in given)])
    corners = columns[part.triangles]
    low = corners[:, :, 2].min(axis=1) < below_m
    if not low.any():
        return part
    done, triangles = [corners[~low]], corners[low]
    while len(triangles):
        sides = np.linalg.norm((np.roll(triangles, -1, axis=1) - triangles)[..., :3], axis=2)
        small = (sides.max(axis=1) <= longest_m) | (triangles[:, :, 2].min(axis=1) >= below_m)
        done.append(triangles[small])
        triangles, first = triangles[~small], sides[~small].argmax(axis=1)
        rows = np.arange(len(triangles))
        a, b, c = (triangles[rows, (first + k) % 3] for k in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    flat = np.concatenate(done).reshape(-1, columns.shape[1])
    ends = np.cumsum([3, *(getattr(part, name).shape[1] for name in given)])
    values: dict[str, Any] = dict(zip(given, np.split(flat, ends[:-1], axis=1)[1:], strict=True))
    return replace(part, vertices=flat[:, :3], triangles=np.arange(len(flat)).reshape(-1, 3), **values)


def _cut(triangles: Array, longest_m: float) -> Array:
    """Triangles (n, 3, 3) bisected at their longest sides until none exceeds longest_m, except slender ones."""
    done = []
    while len(triangles):
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = sides.max(axis=1)
        area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
        small = (longest <= longest_m) | (area < SLENDER_M * longest)
        done.append(triangles[small])
        triangles, sides = triangles[~small], sides[~small]
        first = sides.argmax(axis=1)
        rows = np.arange(len(triangles))
        a, b, c = (triangles[rows, (first + k) % 3] for k in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)
