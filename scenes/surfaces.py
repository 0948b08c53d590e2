"""Rendered surfaces as seen by ranging sensors: static and moving parts, with their alpha masks."""

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.renderables import Mover, Part
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.geometry.bvh import Tree, build_tree
from uavbench.trajectories.geometry.rays import first_hits
from uavbench.trajectories.geometry.surfaces import Struck, barycentric, incidence, strike_mesh
from uavbench.trajectories.pose import Array

MOST_HOLES = 64
"""Most masked-out surfaces that one ray may pass."""
STEP_BEHIND_M = 1e-6
"""Offset behind a masked-out surface point at which a ray continues, metres."""
COARSE_NS = 50_000_000
"""Interval of the coarse test of moving parts against rays, ns."""


class SceneSurfaces:
    """Parts and movers of a scene; the bounding-volume hierarchies are built when the first ray is cast."""

    def __init__(self, parts: Iterable[Part], movers: tuple[Mover, ...]) -> None:
        self._parts, self._movers = tuple(part for part in parts if len(part.triangles)), movers

    def strike(self, origins_m: Array, directions: Array, times_ns: NDArray[np.int64]) -> Struck:
        """First hits of rays from origins (k, 3) along unit directions (k, 3), each at its time of the flight."""
        struck = self._still(origins_m, directions)
        if not len(origins_m):
            return struck
        for mover, corners, tree in self._moving:
            rays = _near(mover, corners, origins_m, directions, times_ns)
            found = Struck(np.full(len(origins_m), np.inf), np.zeros(len(origins_m)))
            for time_ns in np.unique(times_ns[rays]).tolist():
                at = rays[times_ns[rays] == time_ns]
                part_from_world = mover.world_from_part(time_ns * 1e-9).inverse()
                ways = exact.product(directions[at], part_from_world.rotation.T)
                met = strike_mesh(corners, tree, part_from_world.transform(origins_m[at]), ways)
                found.distances_m[at], found.cosines[at] = met.distances_m, met.cosines
            struck = struck.or_nearer(found)
        return struck

    @cached_property
    def _corners(self) -> Array:
        return np.concatenate([np.zeros((0, 3, 3)), *(part.vertices[part.triangles] for part in self._parts)])

    @cached_property
    def _tree(self) -> Tree | None:
        return build_tree(self._corners) if len(self._corners) else None

    @cached_property
    def _first(self) -> NDArray[np.int64]:
        """Row of each part's first triangle."""
        counts = np.array([len(part.triangles) for part in self._parts], dtype=np.int64)
        return np.cumsum(counts) - counts

    @cached_property
    def _has_holes(self) -> NDArray[np.bool_]:
        return np.repeat([part.cutout for part in self._parts], [len(part.triangles) for part in self._parts])

    @cached_property
    def _moving(self) -> list[tuple[Mover, Array, Tree]]:
        corners = [mover.part.vertices[mover.part.triangles] for mover in self._movers]
        return [(mover, each, build_tree(each)) for mover, each in zip(self._movers, corners, strict=True) if len(each)]

    def _still(self, origins_m: Array, directions: Array) -> Struck:
        distances, cosines = np.full(len(origins_m), np.inf), np.zeros(len(origins_m))
        if self._tree is None:
            return Struck(distances, cosines)
        rays, gone = np.arange(len(origins_m)), np.zeros(len(origins_m))
        for _ in range(MOST_HOLES):
            starts = origins_m[rays] + gone[rays, None] * directions[rays]
            hits = first_hits(self._tree, starts, np.ascontiguousarray(directions[rays]))
            met = hits.rows >= 0
            through = np.zeros(len(rays), dtype=bool)
            holed = np.flatnonzero(met)[self._has_holes[hits.rows[met]]]
            places = starts[holed] + hits.distances[holed, None] * directions[rays[holed]]
            through[holed] = self._in_hole(hits.rows[holed], places)
            ends = met & ~through
            distances[rays[ends]] = gone[rays[ends]] + hits.distances[ends]
            cosines[rays[ends]] = incidence(self._corners[hits.rows[ends]], directions[rays[ends]])
            gone[rays[through]] += hits.distances[through] + STEP_BEHIND_M
            rays = rays[through]
            if not len(rays):
                break
        return Struck(distances, cosines)

    def _in_hole(self, rows: NDArray[np.int64], places: Array) -> NDArray[np.bool_]:
        """Mask (k,) of points (k, 3) on triangles (k,) at which the texture's alpha mask is transparent."""
        hole = np.zeros(len(rows), dtype=bool)
        owner = np.searchsorted(self._first, rows, side="right") - 1
        for number in np.unique(owner).tolist():
            mine, part = owner == number, self._parts[number]
            assert part.texture is not None and part.uv is not None
            corner_uv = part.uv[part.triangles[rows[mine] - self._first[number]]]
            uv = np.einsum("ki,kij->kj", barycentric(self._corners[rows[mine]], places[mine]), corner_uv)
            h, w = part.texture.shape[:2]
            column = np.floor(uv[:, 0] * w).astype(np.int64) % w
            row = np.floor((1.0 - uv[:, 1]) * h).astype(np.int64) % h
            hole[mine] = part.texture[row, column, 3] < 128
        return hole


def _near(
    mover: Mover, corners_m: Array, origins_m: Array, directions: Array, times_ns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Rays that may hit a moving part: those through its bounding sphere over a coarse time step."""
    middle = (corners_m.min(axis=(0, 1)) + corners_m.max(axis=(0, 1))) / 2
    radius = float(np.linalg.norm(corners_m - middle, axis=2).max())
    first, last = int(times_ns.min()) // COARSE_NS, int(times_ns.max()) // COARSE_NS + 1
    coarse = [mover.world_from_part(k * COARSE_NS * 1e-9).transform(middle[None])[0] for k in range(first, last + 1)]
    ball = np.array(coarse)[times_ns // COARSE_NS - first]
    after = np.array(coarse)[times_ns // COARSE_NS - first + 1]
    reach = radius + np.linalg.norm(after - ball, axis=1) * 2 + 0.1
    to_ball = ball - origins_m
    along = np.maximum(np.einsum("ij,ij->i", to_ball, directions), 0.0)
    apart = np.linalg.norm(to_ball - along[:, None] * directions, axis=1)
    return np.flatnonzero(apart < reach)
