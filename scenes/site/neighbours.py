"""Neighbouring buildings: detached blocks of flats on plots around the structure, aligned with it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import cover_all
from uavbench.scenes.renderables import Part, Roadway
from uavbench.scenes.site.terrain import Terrain
from uavbench.scenes.structures.building import Building
from uavbench.scenes.structures.facade import Finish, window_and_door_looks
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.pose import Array

STOREYS, STOREY_M = (2, 5), (2.75, 3.3)
"""Number and height of storeys: rooms at least 2.4 m high (Musterbauordnung 2002, section 47) below floors of 0.35 m,
and the uppermost floor below the 22 m of a high-rise (section 2)."""
LONG_M, DEEP_M = (12.0, 26.0), (9.0, 13.0)
"""Lengths and depths of the blocks, metres: one to three stairs' flats, with windows on both sides."""
BAY_M = 2.9
"""Width of a bay with one window, metres."""
APART_M = (6.0, 11.0)
"""Distances between blocks, metres: each keeps 3 m and 0.4 times its height from its plot's edge at least
(Musterbauordnung 2002, section 6)."""
BEYOND_M = 30.0
"""Length of the rows along x beyond the corners of the line that blocks keep, metres."""
SETBACK_M = 6.0
"""Most distance of a block behind the line that all keep from the structure, metres."""
SKEW = 0.12
"""Standard deviation of the blocks' relative brightness."""
FACET_M = 100.0
"""Longest side of a triangle, metres: no light is baked into blocks, so that they need no vertices in between."""
CLEAR_M = 1.0
"""Least distance from a block to a camera, or to clutter on the ground, metres."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Blocks as parts, their lowest and highest corners (k, 2, 3), and the bounds (2, 3) of the structure, metres."""

    parts: tuple[Part, ...]
    boxes: Array
    bounds: Array

    def covers(self, points: Array) -> NDArray[np.bool_]:
        """Mask (n,) of points (n, 2) on the ground less than CLEAR_M from a block."""
        low, high = self.boxes[:, 0, :2] - CLEAR_M, self.boxes[:, 1, :2] + CLEAR_M
        within: NDArray[np.bool_] = (points[:, None] > low) & (points[:, None] < high)
        return np.asarray((within[..., 0] & within[..., 1]).any(axis=1))

    def hides(self, eyes: Array) -> NDArray[np.bool_]:
        """Mask (n,) of viewpoints (n, 3) with a block closer than CLEAR_M to the way to the structure's bounds."""
        ends = np.clip(eyes, self.bounds[0], self.bounds[1])
        low, high = self.boxes[:, 0] - CLEAR_M, self.boxes[:, 1] + CLEAR_M
        way = (ends - eyes)[:, None] + 1e-12
        first, second = (low - eyes[:, None]) / way, (high - eyes[:, None]) / way  # slabs (Kay & Kajiya 1986)
        enters = np.minimum(first, second).max(axis=2)
        leaves = np.maximum(first, second).min(axis=2)
        return np.asarray(((enters <= leaves) & (leaves >= 0) & (enters <= 1)).any(axis=1))


def neighbours(
    count: int, from_m: float, terrain: Terrain, road: Roadway | None, rng: np.random.Generator
) -> Neighbours:
    """`count` blocks on level, free ground at least from_m metres from the structure's bounds.

    UserError when fewer plots are free. No block stands in the line of the structure's road.
    """
    plots = [plot for plot in _plots(terrain.bounds, from_m, rng) if _is_free(plot, terrain, road)]
    if len(plots) < count:
        raise UserError(
            f"environment.site.neighbours: {count} buildings asked for, but only {len(plots)} plots around the "
            "structure are free; give that number or less, or raise neighbours_from_m"
        )
    chosen = np.sort(rng.permutation(len(plots))[:count]).tolist()
    surfaces, stone, looks = _surfaces(rng), materials.concrete(rng, boards=False), window_and_door_looks(rng)
    finishes = [Finish(surface, stone, looks) for surface in surfaces]
    blocks = [_block(plots[k], finishes[int(rng.integers(len(finishes)))], rng) for k in chosen]
    corners = [np.concatenate([part.vertices for part in block]) for block in blocks]
    boxes = np.array([[at.min(axis=0), at.max(axis=0)] for at in corners]).reshape(-1, 2, 3)
    return Neighbours(tuple(part for block in blocks for part in block), boxes, terrain.bounds)


def _plots(bounds: Array, from_m: float, rng: np.random.Generator) -> list[Array]:
    """Footprints (2, 2), lowest and highest (x, y), in rows along the four sides of the structure's bounds."""
    low, high = bounds[0, :2] - from_m, bounds[1, :2] + from_m
    out = []
    for axis in (0, 1):
        for side in (-1, 1):
            reach = BEYOND_M if axis == 0 else -APART_M[0]  # the rows along x include the corners
            at, end = low[axis] - reach, high[axis] + reach
            while at + LONG_M[0] <= end:
                long, deep = min(rng.uniform(*LONG_M), end - at), rng.uniform(*DEEP_M)
                front = rng.uniform(0, SETBACK_M)
                edge = high[1 - axis] + front if side > 0 else low[1 - axis] - front - deep
                plot = np.array([[at, edge], [at + long, edge + deep]])
                out.append(plot if axis == 0 else plot[:, ::-1])
                at += long + rng.uniform(*APART_M)
    return out


def _is_free(plot: Array, terrain: Terrain, road: Roadway | None) -> bool:
    """Whether a footprint is on free ground, and clear of the line of the structure's road."""
    share = np.linspace(0, 1, 15)
    x, y = np.meshgrid(*(plot[0, k] - 2 + share * (np.ptp(plot[:, k]) + 4) for k in (0, 1)))
    on_road = road is not None and plot[0, 1] < road.half_width_m + 2 and plot[1, 1] > -road.half_width_m - 2
    return not on_road and bool(terrain.is_free(np.column_stack([x.ravel(), y.ravel()])).all())


def _surfaces(rng: np.random.Generator) -> list[Material]:
    return [
        materials.brick(rng),
        materials.plaster(rng),
        materials.plaster(rng, (196.0, 192.0, 186.0)),
        materials.plaster(rng, (186.0, 160.0, 140.0)),
    ]


def _block(plot: Array, finish: Finish, rng: np.random.Generator) -> list[Part]:
    """A block on a footprint; its walls have a tone of their own."""
    long, deep = (float(side) for side in plot[1] - plot[0])
    storeys = int(rng.integers(STOREYS[0], STOREYS[1] + 1))
    height = storeys * float(rng.uniform(*STOREY_M))
    shape = Building(long, deep, height, max(1, round(long / BAY_M)), storeys)
    tone = 1 + SKEW * float(np.clip(rng.standard_normal(), -2, 2))
    middle = np.array([*plot.mean(axis=0), 0.0])
    solids, panels = shape.raised(finish, rng)
    out = []
    shown = [solid for solid in solids if solid.name != "pipe"]
    for part in (*cover_all(shown, longest_m=FACET_M), *panels):
        tint = np.tile([tone, tone, tone, 1.0], (len(part.vertices), 1))
        vertices = part.vertices + middle
        out.append(replace(part, vertices=vertices, tint=tint, instance=0, name="", distant=True))
    return out
