"""Simple meshes: planar grids, boxes, and their concatenation."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uavbench.scenes.renderables import Part
from uavbench.scenes.structure import Indices
from uavbench.trajectories.pose import Array

BOX_TRIANGLES: Indices = np.array(
    [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
    ]
)  # fmt: skip


class TriangleMesh(NamedTuple):
    """Vertices (n, 3) in metres and triangles (m, 3), counter-clockwise seen from outside."""

    vertices: Array
    triangles: Indices


class Grid(NamedTuple):
    """Mesh of a parallelogram: vertices (n, 3) in metres, triangles (m, 3) with normal u x v, uv (n, 2) in 0..1."""

    vertices: Array
    triangles: Indices
    uv: Array


def box(low: Array | Iterable[float], high: Array | Iterable[float]) -> TriangleMesh:
    """Axis-aligned box between its lowest and highest corners (3,), metres."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return TriangleMesh(np.array([[x, y, z] for z in (z0, z1) for x, y in corners]), BOX_TRIANGLES.copy())


def joined(meshes: Iterable[TriangleMesh]) -> TriangleMesh:
    """The meshes concatenated; vertices are not merged."""
    vertices, triangles, count = [], [], 0
    for points, corners in meshes:
        vertices.append(points)
        triangles.append(corners + count)
        count += len(points)
    return TriangleMesh(np.concatenate(vertices), np.concatenate(triangles))


def panel(
    origin: Array | Iterable[float],
    along_u: Array | Iterable[float],
    along_v: Array | Iterable[float],
    step_m: float,
) -> Grid:
    """Grid on the parallelogram spanned by two sides (3,) at an origin (3,), lines at most step_m metres apart."""
    o, u, v = (np.array(list(x), dtype=np.float64) for x in (origin, along_u, along_v))
    nu = max(1, int(np.ceil(np.linalg.norm(u) / step_m)))
    nv = max(1, int(np.ceil(np.linalg.norm(v) / step_m)))
    return grid(o, u, v, np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1))


def grid(origin: Array, u: Array, v: Array, us: Array, vs: Array) -> Grid:
    """Grid on a parallelogram, as `panel`, with lines at the given fractions us (k,) of u and vs (l,) of v."""
    s, t = np.meshgrid(us, vs)
    uv = np.column_stack([s.ravel(), t.ravel()])
    corner = (np.arange(len(vs) - 1)[:, None] * len(us) + np.arange(len(us) - 1)).ravel()
    w = len(us)
    triangles = np.concatenate(
        [np.column_stack([corner, corner + 1, corner + w + 1]), np.column_stack([corner, corner + w + 1, corner + w])]
    )
    return Grid(origin + uv[:, :1] * u + uv[:, 1:] * v, triangles, uv)


def merged(parts: Iterable[Part]) -> tuple[Part, ...]:
    """The parts merged into one per texture, material, instance and set of vertex attributes; renders identically."""
    alike: dict[tuple[object, ...], list[Part]] = {}
    for part in parts:
        key = (id(part.texture), part.roughness, part.two_sided, part.casts_shadow, part.instance, id(part.ripples))
        further = (part.distant, id(part.film), id(part.soil), part.keeps_cover)
        given = (part.uv is None, part.normals is None, part.tint is None)
        alike.setdefault((*key, *further, *given, id(part) if part.lightmap else 0), []).append(part)
    return tuple(merge(group) for group in alike.values())


def merge(parts: Iterable[Part]) -> Part:
    """Concatenation of parts that share texture and material; each vertex attribute is set in all or none."""
    several = list(parts)
    vertices, triangles = joined(TriangleMesh(p.vertices, p.triangles) for p in several)

    def stacked(name: str) -> Array | None:
        arrays = [getattr(p, name) for p in several]
        return None if arrays[0] is None else np.concatenate(arrays)

    return replace(
        several[0],
        vertices=vertices,
        triangles=triangles,
        uv=stacked("uv"),
        normals=stacked("normals"),
        tint=stacked("tint"),
        soil_uv=stacked("soil_uv"),
    )
