"""Planes of all rendered triangles in float64, for the surface point of a pixel and its motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.renderables import Mover, Part
from uavbench.trajectories.pose import Array, Pose

NONE = -1
"""Row of no facet: background or sky."""
Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes `normal . x = offset` of facets in the world frame at one time.

    normals (n, 3) are unit vectors; offsets_m (n,); corners_m (n, 3, 3) are the vertices of the facets.
    """

    normals: Array
    offsets_m: Array
    corners_m: Array


class DrawnPart(NamedTuple):
    """A part that is drawn, and its motion, None for a static part."""

    part: Part
    mover: Mover | None


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles of all drawn meshes, concatenated.

    first (m,): row of the first triangle of each mesh; corners_m (n, 3, 3) in the frame of the part, which is the world
    for static parts; instances (n,) of their parts; movers: rows and motion of each moving mesh; mover_of (n,): which
    of them a facet belongs to, counted from 1, 0 for none; has_sky: whether the background is a sky.
    """

    first: Rows
    corners_m: Array
    instances: NDArray[np.uint8]
    movers: tuple[tuple[slice, Mover], ...]
    mover_of: Rows
    has_sky: bool

    @classmethod
    def of(cls, drawn: Sequence[DrawnPart], *, has_sky: bool) -> "Facets":
        """Facets of parts in drawing order."""
        counts = np.array([len(part.triangles) for part, _ in drawn], dtype=np.int64)
        first = np.cumsum(counts) - counts
        corners = [part.vertices[part.triangles] for part, _ in drawn]
        movers = tuple(
            (slice(int(begin), int(begin + count)), mover)
            for begin, count, (_, mover) in zip(first, counts, drawn, strict=True)
            if mover is not None
        )
        instances = np.repeat([part.instance for part, _ in drawn], counts).astype(np.uint8)
        mover_of = np.zeros(len(instances), dtype=np.int64)
        for number, (rows, _) in enumerate(movers, 1):
            mover_of[rows] = number
        return cls(first, np.concatenate([np.zeros((0, 3, 3)), *corners]), instances, movers, mover_of, has_sky)

    def planes(self, time_s: float) -> Planes:
        """Planes of all facets at a time in seconds, world frame."""
        corners = self.corners_m
        if self.movers:
            corners = corners.copy()
            for rows, mover in self.movers:
                pose = mover.world_from_part(time_s)
                corners[rows] = pose.transform(corners[rows].reshape(-1, 3)).reshape(-1, 3, 3)
        a, b, c = (corners[:, k] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        return Planes(normals, np.einsum("ij,ij->i", normals, a), corners)

    def steps(self, from_s: float, to_s: float) -> list[Pose]:
        """Motion in the world from one time to another, in seconds, of what rests and of each mover: see `mover_of`."""
        moved = [mover.world_from_part(to_s) @ mover.world_from_part(from_s).inverse() for _, mover in self.movers]
        return [Pose.identity(), *moved]
