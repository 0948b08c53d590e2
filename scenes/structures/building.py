"""A small building: four facades with windows, a door, a flat roof with a parapet and a plant room."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import Solid, block, cells, cover_all, structure_of
from uavbench.scenes.renderables import BuiltStructure, Part
from uavbench.scenes.structures import facade
from uavbench.scenes.structures.facade import (
    COPING_M,
    OVERHANG_M,
    REVEAL_M,
    Finish,
    Opening,
    Side,
    Surface,
    filled,
    inside,
    lines,
)

PARAPET_M = (0.35, 0.9)
"""Thickness and height of the parapet, metres."""


class Raised(NamedTuple):
    """A building's solids, and the textured panels in its openings."""

    solids: list[Solid]
    panels: list[Part]


@dataclass(frozen=True)
class Building:
    """A block with a flat roof, its length along x."""

    length_m: Annotated[float, Gt(4), Interval(le=200)] = 14.0
    width_m: Annotated[float, Gt(4), Interval(le=200)] = 9.0
    height_m: Annotated[float, Gt(2), Interval(le=100)] = 8.0
    bays: Annotated[int, Interval(ge=1, le=40)] = 4
    storeys: Annotated[int, Interval(ge=1, le=12)] = 2
    surface: Surface = "plaster"

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The building, centred on the origin."""
        return self._of(Finish.painted(self.surface, rng), rng)

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(Finish.unpainted(), np.random.default_rng(0))  # which draws the look of windows only

    def _of(self, finish: Finish, rng: np.random.Generator) -> BuiltStructure:
        solids, panels = self.raised(finish, rng)
        doors = facade.doors(self._front_openings(), self._sides()[0])
        return BuiltStructure(structure_of(solids), (*cover_all(solids), *panels), doors=doors)

    def raised(self, finish: Finish, rng: np.random.Generator) -> Raised:
        """The building in given materials; rng draws the look of each window."""
        z = self.height_m
        side_bays = max(1, round(self.bays * self.width_m / self.length_m))
        front = self._front_openings()
        back = facade.openings(self.length_m, z, self.bays, self.storeys, door_bay=None)
        side = facade.openings(self.width_m, z, side_bays, self.storeys, door_bay=None)
        plant = 0.16 * self.length_m
        solids = [
            self._body(front, back, side, finish.surface),
            block((-plant, -0.5 * plant, z), (0.2 * plant, 0.7 * plant, z + 2.2), finish.stone, "plant room"),
        ]
        painted = list[Part]()
        for face, holes, beyond in zip(self._sides(), (front, side, back, side), (OVERHANG_M, 0.0) * 2, strict=True):
            solids += facade.trim(holes, face, beyond, finish.stone)
            solids += [self._coping(face, beyond, finish.stone), facade.downpipe(face, 0.25)]
            painted += filled(holes, face, finish.looks, rng)
        return Raised(solids, painted)

    def _front_openings(self) -> tuple[Opening, ...]:
        return facade.openings(self.length_m, self.height_m, self.bays, self.storeys, door_bay=self.bays // 2)

    def _sides(self) -> list[Side]:
        """Front (-y), right (+x), back, left."""
        x, y, top = self.length_m / 2, self.width_m / 2, self.height_m + PARAPET_M[1]
        out = []
        for k, (cx, cy) in enumerate(((-x, -y), (x, -y), (x, y), (-x, y))):
            along = np.array([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)][k])
            outward = np.array([along[1], -along[0], 0.0])
            out.append(Side(np.array([cx, cy, 0.0]), along, outward, (2 * x, 2 * y)[k % 2], top))
        return out

    def _coping(self, face: Side, beyond: float, stone: Material) -> Solid:
        """Coping of one parapet: `beyond` metres past both ends, or, where that is 0, fitted between the other two."""
        inner = PARAPET_M[0] + OVERHANG_M
        start, stop = (-beyond, face.width_m + beyond) if beyond else (inner, face.width_m - inner)
        top = face.height_m
        return face.block((start, top, -inner), (stop, top + COPING_M, OVERHANG_M), stone, "coping")

    def _body(
        self,
        front: tuple[Opening, ...],
        back: tuple[Opening, ...],
        side: tuple[Opening, ...],
        material: Material,
    ) -> Solid:
        x, y = self.length_m / 2, self.width_m / 2
        thick, rise = PARAPET_M
        xs = lines(-x, x, [c - x for o in front for c in (o.x0, o.x1)] + [x - c for o in back for c in (o.x0, o.x1)]
                   + [-x + REVEAL_M, x - REVEAL_M, -x + thick, x - thick])  # fmt: skip
        ys = lines(-y, y, [c - y for o in side for c in (o.x0, o.x1)] + [y - c for o in side for c in (o.x0, o.x1)]
                   + [-y + REVEAL_M, y - REVEAL_M, -y + thick, y - thick])  # fmt: skip
        heights = [z for o in (*front, *back, *side) for z in (o.z0, o.z1)]
        zs = lines(0, self.height_m + rise, [*heights, self.height_m])
        full = np.ones((len(xs) - 1, len(ys) - 1, len(zs) - 1), dtype=bool)
        roof = np.ix_(
            inside(xs, -x + thick, x - thick),
            inside(ys, -y + thick, y - thick),
            inside(zs, self.height_m, 1e9),
        )
        full[roof] = False
        for o in front:
            full[
                np.ix_(
                    inside(xs, o.x0 - x, o.x1 - x),
                    inside(ys, -y, -y + REVEAL_M),
                    inside(zs, o.z0, o.z1),
                )
            ] = False
        for o in back:
            full[
                np.ix_(
                    inside(xs, x - o.x1, x - o.x0),
                    inside(ys, y - REVEAL_M, y),
                    inside(zs, o.z0, o.z1),
                )
            ] = False
        for o in side:
            up = inside(zs, o.z0, o.z1)
            full[np.ix_(inside(xs, x - REVEAL_M, x), inside(ys, o.x0 - y, o.x1 - y), up)] = False
            full[np.ix_(inside(xs, -x, -x + REVEAL_M), inside(ys, y - o.x1, y - o.x0), up)] = False
        return cells(xs, ys, zs, full, material, "body")
