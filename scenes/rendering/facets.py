"""All rendered triangles in float64, and their motions."""

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


class DrawnPart(NamedTuple):
    """A part that is drawn, and its motion, None for a static part."""

    part: Part
    mover: Mover | None


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles of all drawn meshes, concatenated.

    first (m,): row of the first triangle of each mesh; corners_m (n, 3, 3) in the frame of the part, which is the world
    for static parts; instances (n,) of their parts; masked (n,): 1 for those of parts with an alpha mask, else 0;
    movers: rows and motion of each moving mesh; mover_of (n,): which of them a facet belongs to, counted from 1, 0 for
    none; moving (2,): the first facet that moves, and the one after the last; has_sky: whether the background is a sky.
    """

    first: Rows
    corners_m: Array
    instances: NDArray[np.uint8]
    masked: NDArray[np.uint8]
    movers: tuple[tuple[slice, Mover], ...]
    mover_of: Rows
    moving: Rows
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
        masked = np.repeat([part.cutout for part, _ in drawn], counts).astype(np.uint8)
        mover_of = np.zeros(len(instances), dtype=np.int64)
        for number, (rows, _) in enumerate(movers, 1):
            mover_of[rows] = number
        any_moving = np.flatnonzero(mover_of)
        moving = np.array([any_moving[0], any_moving[-1] + 1] if len(any_moving) else [0, 0], dtype=np.int64)
        all_corners = np.concatenate([np.zeros((0, 3, 3)), *corners])
        return cls(first, all_corners, instances, masked, movers, mover_of, moving, has_sky)

    def steps(self, from_s: float, to_s: float) -> list[Pose]:
        """Motion in the world from one time to another, in seconds, of each mover."""
        return [mover.world_from_part(to_s) @ mover.world_from_part(from_s).inverse() for _, mover in self.movers]
