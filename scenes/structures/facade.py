"""Details of a facade: openings, sills, plinth, coping and pipe."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import Solid, block, circle, picture, prism
from uavbench.scenes.renderables import Part
from uavbench.trajectories.pose import Array

REVEAL_M = 0.18
SILL_M, PLINTH_M, COPING_M = 0.08, 0.45, 0.1
"""Heights of a sill, the plinth and the coping, metres."""
OVERHANG_M = 0.06
PIPE_M = 0.05
STONE = (186.0, 182.0, 172.0)
"""Mean colour (BGR) of the stone of sills, plinths and copings."""
Surface = Literal["brick", "panels", "plaster", "concrete"]


@dataclass(frozen=True)
class Opening:
    """A door or window opening in a facade: x0..x1 along it and z0..z1 upwards, in metres."""

    x0: float
    x1: float
    z0: float
    z1: float
    door: bool = False


@dataclass(frozen=True, eq=False)
class Side:
    """A vertical, axis-aligned face of a building.

    corner (3,) is the lower left one seen from outside, in metres; along and outward (3,) are unit vectors.
    """

    corner: Array
    along: Array
    outward: Array
    width_m: float
    height_m: float

    def at(self, along_m: float, up_m: float, out_m: float = 0.0) -> Array:
        """Point (3,) in the world frame, metres: along_m and up_m from the corner, out_m in front of the facade."""
        return np.asarray(self.corner + along_m * self.along + out_m * self.outward + [0.0, 0.0, up_m])

    def block(
        self, low: tuple[float, float, float], high: tuple[float, float, float], material: Material, name: str
    ) -> Solid:
        """Axis-aligned block between two corners (along, up, out) in metres."""
        ends = np.array([self.at(*low), self.at(*high)])
        return block(ends.min(axis=0), ends.max(axis=0), material, name)


def openings(width_m: float, height_m: float, bays: int, storeys: int, door_bay: int | None) -> tuple[Opening, ...]:
    """A window centred in each bay of each storey, and a door in bay door_bay of the ground floor (None: no door)."""
    bay, storey = width_m / bays, height_m / storeys
    w, h = min(0.45 * bay, 1.4), min(0.52 * storey, 1.7)
    out = []
    for level in range(storeys):
        for k in range(bays):
            x = (k + 0.5) * bay
            if level == 0 and k == door_bay:
                out.append(Opening(x - 0.5, x + 0.5, 0.0, min(2.1, 0.8 * storey), door=True))
            else:
                z = level * storey + 0.32 * storey
                out.append(Opening(x - w / 2, x + w / 2, z, z + h))
    return tuple(out)


def doors(holes: tuple[Opening, ...], side: Side) -> Array:
    """Ends (n, 2, 2) of each door on the ground, x and y in metres."""
    return np.array([[side.at(x, 0.0)[:2] for x in (o.x0, o.x1)] for o in holes if o.door]).reshape(-1, 2, 2)


def trim(holes: tuple[Opening, ...], side: Side, beyond_m: float, stone: Material) -> list[Solid]:
    """Sills below the windows, and a plinth with gaps for the doors that extends beyond_m past both ends."""
    doors = sorted((o.x0, o.x1) for o in holes if o.door)
    starts = [-beyond_m, *(x1 for _, x1 in doors)]
    stops = [*(x0 for x0, _ in doors), side.width_m + beyond_m]
    low = min([PLINTH_M, *(o.z0 - SILL_M for o in holes if not o.door)])
    solids = []
    if low > 0.1:
        solids += [
            side.block((a, 0.0, 0.0), (b, low, OVERHANG_M), stone, "plinth")
            for a, b in zip(starts, stops, strict=True)
            if b > a
        ]
    return solids + [
        side.block((o.x0 - OVERHANG_M, o.z0 - SILL_M, 0.0), (o.x1 + OVERHANG_M, o.z0, 0.07), stone, "sill")
        for o in holes
        if not o.door
    ]


def downpipe(side: Side, along_m: float) -> Solid:
    """A rainwater pipe from the coping to the ground."""
    foot, head = (side.at(along_m, up, OVERHANG_M + PIPE_M + 0.01) for up in (0.0, side.height_m))
    zinc = Material(np.full((8, 8, 3), (132, 136, 138), dtype=np.uint8), (1.0, 1.0), 0.5)
    return prism(circle(PIPE_M, 8), foot, head, zinc, "pipe")


def filled(holes: tuple[Opening, ...], side: Side, looks: list[Material], rng: np.random.Generator) -> list[Part]:
    """Textured panels at the back of the openings; looks are the materials of windows, the last one that of doors."""
    parts = []
    for o in holes:
        corner = side.at(o.x0, o.z0, 0.002 - REVEAL_M)
        look = looks[-1] if o.door else looks[int(rng.integers(len(looks) - 1))]
        parts.append(picture(corner, (o.x1 - o.x0) * side.along, np.array([0.0, 0.0, o.z1 - o.z0]), look))
    return parts


@dataclass(frozen=True, eq=False)
class Finish:
    """Materials of a facade: its surface, the stone of its trim, looks of windows and, as the last, of doors."""

    surface: Material
    stone: Material
    looks: list[Material]

    @classmethod
    def painted(cls, surface: Surface, rng: np.random.Generator) -> "Finish":
        """A surface with trim of pale stone."""
        paint = materials.PAINTS[surface](rng)
        stone = materials.concrete(rng, STONE, boards=False)
        return cls(paint, stone, window_and_door_looks(rng))

    @classmethod
    def unpainted(cls) -> "Finish":
        """One plain material: for geometry without the time of painting."""
        return cls(materials.UNPAINTED, materials.UNPAINTED, [materials.UNPAINTED] * 2)


def window_and_door_looks(rng: np.random.Generator) -> list[Material]:
    """Materials of several windows, and of a door as the last."""
    return [*(materials.window(rng) for _ in range(5)), materials.door(rng)]


def lines(low: float, high: float, cuts: list[float]) -> Array:
    """Sorted, distinct grid lines from low to high through all cuts."""
    return np.unique(np.round([low, high, *cuts], 9))


def inside(grid: Array, low: float, high: float) -> NDArray[np.bool_]:
    """Mask (n - 1,) of the cells of grid lines (n,) that lie between low and high."""
    middle = (grid[1:] + grid[:-1]) / 2
    return (middle > low) & (middle < high)
