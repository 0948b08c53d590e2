"""Dirt on facades: streaks that run from ledges and sills, and the splash of rain at the foot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.procedural_texture import Image
from uavbench.scenes.primitives.meshes import TriangleMesh, joined
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array

SPLASH_M = 0.30
"""Height of the zone that splashing rain soils, metres (DIN 18533-1:2017: at least 0.3 m above the ground)."""
RUN_M = 0.9
"""Length of streaks below a ledge at which they have faded to 1/e, metres; by eye."""
STREAK_M = 0.07
"""Width of a streak, metres; by eye."""
LEDGE_M = 0.03
"""A ledge sheds water if it protrudes this far from the wall beneath, metres."""
STREAKED, SPLASHED = 0.62, 0.45
"""Most share of the albedo that streaks and splash take away."""
SOOT = np.array([0.94, 1.0, 1.07])
"""Share of red, green and blue in what is taken away: dirt is brownish."""
LEAST_M2, GLASS = 1.0, 0.3
"""Least area of a facade, m2; surfaces smoother than this are glass, which is cleaned."""
CELL_M, COARSE = (0.025, 0.05), 3
"""Size of a texel along and up a facade, metres; rays are cast for every COARSE-th."""
MOST_TEXELS, GAP_PX, CLEAN_PX = 2_000_000, 4, 32
"""Most texels of a structure's facades together, the gap around each of them, and the height of a clean strip."""


@dataclass(frozen=True, eq=False)
class _Facade:
    """A vertical plane: level axis along (3,), outward normal (3,), offset_m along it, and extent (2, 2).

    The extent is the lowest and highest place along the axis and upwards; rows x columns texels cover it.
    """

    along: Array
    outward: Array
    offset_m: float
    extent: Array
    rows: int
    columns: int

    @property
    def size(self) -> int:
        """Number of texels."""
        return self.rows * self.columns

    def at(self, rows: int, columns: int) -> Array:
        """Points (rows * columns, 3) at the middles of a grid on the facade, from the top down, LEDGE_M before it."""
        (s0, z0), (s1, z1) = self.extent
        s = s0 + (np.arange(columns) + 0.5) / columns * (s1 - s0)
        z = z1 - (np.arange(rows)[:, None] + 0.5) / rows * (z1 - z0)
        level = s[:, None] * self.along + (self.offset_m + LEDGE_M) * self.outward
        return np.asarray(level[None] + z[..., None] * np.array([0.0, 0.0, 1.0])).reshape(-1, 3)


def dirtied(parts: Sequence[Part], share: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """The parts with soiled facades; share 1 is a structure that was never cleaned. Glass stays clean."""
    solid = ObstacleMesh(*joined(TriangleMesh(p.vertices, p.triangles) for p in parts if not p.cutout))
    several = [_planes(part) for part in parts]
    keys, which = np.unique(np.concatenate(several), axis=0, return_inverse=True)
    corners = np.concatenate([part.vertices[part.triangles] for part in parts])
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    wide = (np.bincount(which.reshape(-1), area, len(keys)) >= LEAST_M2) & keys[:, :2].any(axis=1)
    chosen = np.where(wide, np.cumsum(wide) - 1, -1)[which.reshape(-1)]
    sheets = [corners[chosen == k] for k in range(int(wide.sum()))]
    if not sheets:
        return tuple(parts)
    coarser = max(1.0, float(np.sqrt(sum(_facade(sheet, 1.0).size for sheet in sheets) / MOST_TEXELS)))
    facades = [_facade(sheet, coarser) for sheet in sheets]
    atlas, places = _packed([_dirt(facade, solid, share, rng) for facade in facades])
    ends = np.cumsum([len(part.triangles) for part in parts])[:-1]
    return tuple(
        _mapped(part, of, facades, places, atlas) if (of >= 0).any() else part
        for part, of in zip(parts, np.split(chosen, ends), strict=True)
    )


def _planes(part: Part) -> NDArray[np.int64]:
    """Key (m, 3) of the plane of each triangle: its normal in 1/1000 and its offset in mm; zeros unless a facade's."""
    a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    offsets = np.einsum("ij,ij->i", normals, a)
    keys = np.rint(1000 * np.column_stack([normals[:, :2], offsets])).astype(np.int64)
    if part.roughness < GLASS or part.cutout:
        return np.zeros_like(keys)
    return np.where(np.abs(normals[:, 2:]) < 0.01, keys, 0)


def _facade(corners: Array, coarser: float) -> _Facade:
    """The facade of coplanar triangles (m, 3, 3), with texels `coarser` times as large as CELL_M."""
    a, b, c = corners[0]
    outward = np.cross(b - a, c - a) * [1.0, 1.0, 0.0]
    outward /= np.linalg.norm(outward)
    along = np.array([-outward[1], outward[0], 0.0])
    places = np.stack([corners.reshape(-1, 3) @ along, corners.reshape(-1, 3)[:, 2]], axis=1)
    extent = np.array([places.min(axis=0), places.max(axis=0)])
    columns, rows = np.maximum(np.ceil(np.ptp(extent, axis=0) / np.array(CELL_M) / coarser), 1).astype(int).tolist()
    return _Facade(along, outward, float(a @ outward), extent, rows, columns)


def _dirt(facade: _Facade, solid: ObstacleMesh, share: float, rng: np.random.Generator) -> Image:
    """Share (rows, columns, 3) of the albedo that dirt leaves."""
    rows, columns = facade.rows, facade.columns
    few = (-(-rows // COARSE), -(-columns // COARSE))
    points = facade.at(*few)
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    below = np.minimum(solid.ray(points, np.ascontiguousarray(up)), 20 * RUN_M).reshape(few)
    ledge = cv2.resize(np.asarray(below, dtype=np.float32), (columns, rows), interpolation=cv2.INTER_NEAREST)
    px = columns / max(float(np.ptp(facade.extent[:, 0])), 1e-6)
    tile = max(64, 2 * -(-columns // 2))
    runs = noise.tiling((1, tile), (1.0, max(STREAK_M * px, 1.5)), rng)[0, :columns]
    lengths = noise.tiling((1, tile), (1.0, max(3 * STREAK_M * px, 3.0)), rng)[0, :columns]
    reach = RUN_M * np.exp(0.6 * np.clip(lengths, -2, 2))
    streaks = np.clip(0.30 + 0.45 * runs, 0, 1.2) * np.exp(-ledge / reach)
    height = points.reshape(*few, 3)[..., 2]
    height = np.asarray(cv2.resize(height[:, :1], (1, rows), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    patches = 1 + 0.35 * noise.tiling((max(rows, 64), tile), 0.25 * px, rng)[:rows, :columns]
    splash = np.exp(-np.clip(height / SPLASH_M, 0, 50) * 0.8) * patches
    taken = share * np.clip(STREAKED * streaks + SPLASHED * splash, 0, 0.85)
    return np.asarray(1 - taken[..., None] * SOOT, dtype=np.float32).clip(0, 1)


def _packed(charts: list[Image]) -> tuple[Texture, list[tuple[int, int]]]:
    """One square-sided texture of all charts, in shelves, each within GAP_PX of its own edge; and their corners."""
    wide = max(max(chart.shape[1] for chart in charts), round(sum(chart[..., 0].size for chart in charts) ** 0.5))
    width = wide + 2 * GAP_PX
    places, row, column, tall = dict[int, tuple[int, int]](), 0, 0, 0
    for k in sorted(range(len(charts)), key=lambda k: -charts[k].shape[0]):
        rows, columns = (n + 2 * GAP_PX for n in charts[k].shape[:2])
        if column + columns > width:
            row, column, tall = row + tall, 0, 0
        places[k] = (row + GAP_PX, column + GAP_PX)
        column, tall = column + columns, max(tall, rows)
    atlas = np.full((row + tall + CLEAN_PX, width, 3), 255, dtype=np.uint8)
    for k, (top, left) in places.items():
        edged = cv2.copyMakeBorder(charts[k], *(GAP_PX,) * 4, cv2.BORDER_REPLICATE)
        h, w = edged.shape[:2]
        atlas[top - GAP_PX : top - GAP_PX + h, left - GAP_PX : left - GAP_PX + w] = np.rint(255 * edged)
    return atlas, [places[k] for k in range(len(charts))]


def _mapped(
    part: Part, of: NDArray[np.int64], facades: list[_Facade], places: list[tuple[int, int]], atlas: Texture
) -> Part:
    """The part with a vertex per corner, each at its place in the atlas; triangles of no facade are clean."""
    flat = part.triangles.reshape(-1)
    given = {name: getattr(part, name) for name in ("normals", "uv", "tint") if getattr(part, name) is not None}
    vertices, owner = part.vertices[flat], np.repeat(of, 3)
    height, width = atlas.shape[:2]
    spots = np.tile([0.5, 0.5 * CLEAN_PX / height], (len(flat), 1))
    for k in np.unique(owner[owner >= 0]).tolist():
        mine, facade, (top, left) = owner == k, facades[k], places[k]
        s, z = vertices[mine] @ facade.along, vertices[mine, 2]
        (s0, z0), (s1, z1) = facade.extent
        column = left + (s - s0) / (s1 - s0) * facade.columns
        row = top + (z1 - z) / (z1 - z0) * facade.rows
        spots[mine] = np.column_stack([column / width, 1 - row / height])
    return replace(
        part,
        vertices=vertices,
        triangles=np.arange(len(flat)).reshape(-1, 3),
        soil=atlas,
        soil_uv=spots,
        **{name: values[flat] for name, values in given.items()},
    )
