"""A facade: windows and a door set back, sills, a parapet with its coping; brick, panels, plaster or concrete."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt, Interval

from scenes import materials
from scenes.facade import Opening, inside, lines, openings
from scenes.materials import Material
from scenes.parts import BuiltStructure, Part
from scenes.solids import Solid, block, cells, cover_all, picture, structure_of

REVEAL_M = 0.18
SILL_M = 0.08


@dataclass(frozen=True)
class Wall:
    """A free-standing facade along x, its front towards -y."""

    width_m: Annotated[float, Gt(2), Interval(le=100)] = 12.0
    height_m: Annotated[float, Gt(2), Interval(le=50)] = 7.0
    thickness_m: Annotated[float, Gt(0.25), Interval(le=3)] = 0.45
    bays: Annotated[int, Interval(ge=1, le=40)] = 4
    storeys: Annotated[int, Interval(ge=1, le=12)] = 2
    surface: Literal["brick", "panels", "plaster", "concrete"] = "brick"

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The facade, its middle at the origin."""
        surface = materials.PAINTS[self.surface](rng)
        stone = materials.concrete(rng, (186.0, 182.0, 172.0), boards=False)
        holes = openings(self.width_m, self.height_m, self.bays, self.storeys, door_bay=self.bays // 2)
        solids = [self._slab(holes, surface), *self._trim(holes, stone)]
        return BuiltStructure(structure_of(solids), (*cover_all(solids), *filled(holes, self._at, rng)))

    def _at(self, x: float, z: float) -> np.ndarray:
        return np.array([x - self.width_m / 2, REVEAL_M - 0.002, z])

    def _slab(self, holes: tuple[Opening, ...], material: Material) -> Solid:
        xs = lines(0, self.width_m, [x for o in holes for x in (o.x0, o.x1)])
        zs = lines(0, self.height_m, [z for o in holes for z in (o.z0, o.z1)])
        ys = np.array([0.0, REVEAL_M, self.thickness_m])
        full = np.ones((len(xs) - 1, 2, len(zs) - 1), dtype=bool)
        for o in holes:
            full[np.ix_(inside(xs, o.x0, o.x1), inside(ys, 0, REVEAL_M), inside(zs, o.z0, o.z1))] = False
        return cells(xs - self.width_m / 2, ys, zs, full, material, "wall")

    def _trim(self, holes: tuple[Opening, ...], stone: Material) -> list[Solid]:
        half = self.width_m / 2
        top = block(
            (-half - 0.06, -0.06, self.height_m), (half + 0.06, self.thickness_m + 0.06, self.height_m + 0.1), stone
        )
        sills = [
            block((o.x0 - half - 0.06, -0.07, o.z0 - SILL_M), (o.x1 - half + 0.06, 0.0, o.z0), stone, "sill")
            for o in holes
            if not o.door
        ]
        return [top, *sills]


def filled(holes: tuple[Opening, ...], at: object, rng: np.random.Generator) -> list[Part]:
    """Windows and doors painted on the back of their recesses; `at` places a point (along, up) of the facade."""
    assert callable(at)
    looks = [materials.window(rng) for _ in range(3)]
    wood = materials.door(rng)
    parts = []
    for o in holes:
        corner = at(o.x0, o.z0)
        look = wood if o.door else looks[int(rng.integers(len(looks)))]
        parts.append(picture(corner, at(o.x1, o.z0) - corner, at(o.x0, o.z1) - corner, look))
    return parts
