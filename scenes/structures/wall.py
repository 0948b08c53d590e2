"""A facade: recessed windows and door, sills, coping; in brick, panels, plaster or concrete."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import Solid, cells, cover_all, structure_of
from uavbench.scenes.renderables import BuiltStructure
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


@dataclass(frozen=True)
class Wall:
    """A free-standing facade along x, its front towards -y."""

    width_m: Annotated[float, Gt(2), Interval(le=100)] = 12.0
    height_m: Annotated[float, Gt(2), Interval(le=50)] = 7.0
    thickness_m: Annotated[float, Gt(0.25), Interval(le=3)] = 0.45
    bays: Annotated[int, Interval(ge=1, le=40)] = 4
    storeys: Annotated[int, Interval(ge=1, le=12)] = 2
    surface: Surface = "brick"

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The facade, centred on the origin."""
        return self._of(Finish.painted(self.surface, rng), rng)

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(Finish.unpainted(), np.random.default_rng(0))  # which draws the look of windows only

    def _of(self, finish: Finish, rng: np.random.Generator) -> BuiltStructure:
        holes = facade.openings(self.width_m, self.height_m, self.bays, self.storeys, door_bay=self.bays // 2)
        solids = [self._slab(holes, finish.surface), *facade.trim(holes, self._front, 0.0, finish.stone)]
        solids.append(self._coping(finish.stone))
        solids.append(facade.downpipe(self._front, 0.3))
        parts = (*cover_all(solids), *filled(holes, self._front, finish.looks, rng))
        return BuiltStructure(structure_of(solids), parts, doors=facade.doors(holes, self._front))

    @property
    def _front(self) -> Side:
        corner, along, outward = np.array([[-self.width_m / 2, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        return Side(corner, along, outward, self.width_m, self.height_m)

    def _slab(self, holes: tuple[Opening, ...], material: Material) -> Solid:
        xs = lines(0, self.width_m, [x for o in holes for x in (o.x0, o.x1)])
        zs = lines(0, self.height_m, [z for o in holes for z in (o.z0, o.z1)])
        ys = np.array([0.0, REVEAL_M, self.thickness_m])
        full = np.ones((len(xs) - 1, 2, len(zs) - 1), dtype=bool)
        for o in holes:
            full[np.ix_(inside(xs, o.x0, o.x1), inside(ys, 0, REVEAL_M), inside(zs, o.z0, o.z1))] = False
        return cells(xs - self.width_m / 2, ys, zs, full, material, "wall")

    def _coping(self, stone: Material) -> Solid:
        low = (-OVERHANG_M, self.height_m, -self.thickness_m - OVERHANG_M)
        return self._front.block(
            low, (self.width_m + OVERHANG_M, self.height_m + COPING_M, OVERHANG_M), stone, "coping"
        )
