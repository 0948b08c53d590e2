"""A lattice tower of square hollow sections on concrete footings: four legs, horizontal rings and X bracing."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import Solid, block, cover_all, prism, structure_of
from uavbench.scenes.renderables import BuiltStructure
from uavbench.trajectories.pose import Array


@dataclass(frozen=True)
class Truss:
    """A lattice tower at the origin that tapers from base_m to top_m over a number of panels."""

    height_m: Annotated[float, Gt(1), Interval(le=100)] = 8.0
    base_m: Annotated[float, Gt(0.3), Interval(le=50)] = 2.4
    top_m: Annotated[float, Gt(0.2), Interval(le=50)] = 1.4
    panels: Annotated[int, Interval(ge=1, le=40)] = 4
    leg_m: Annotated[float, Gt(0.01), Interval(le=2)] = 0.14

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The tower in painted steel, on concrete footings."""
        steel = materials.painted_steel(rng, (142.0, 62.0, 48.0))
        return self._of(steel, materials.concrete(rng, boards=False))

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(materials.UNPAINTED, materials.UNPAINTED)

    def _of(self, steel: Material, concrete: Material) -> BuiltStructure:
        foot = 0.4
        levels = np.linspace(foot, foot + self.height_m, self.panels + 1)
        rings = [self._ring(float(z), foot) for z in levels]
        solids: list[Solid] = []
        for corner in rings[0]:
            r = 1.8 * self.leg_m
            solids.append(block((*(corner[:2] - r), 0), (*(corner[:2] + r), foot), concrete, "foot"))
        for k in range(4):
            solids.append(self._bar(rings[0][k], rings[-1][k], self.leg_m, steel, f"leg {k}"))
        for level, ring in enumerate(rings):
            for k in range(4):
                a, b = ring[k], ring[(k + 1) % 4]
                if level > 0:
                    solids.append(self._bar(a, b, 0.6 * self.leg_m, steel, f"ring {level}"))
                if level < self.panels:
                    above = rings[level + 1]
                    solids.append(self._bar(a, above[(k + 1) % 4], 0.45 * self.leg_m, steel, f"diagonal {level}"))
                    inward = -0.5 * self.leg_m * (a + b) / np.linalg.norm(a[:2] + b[:2]) * [1, 1, 0]
                    solids.append(
                        self._bar(b + inward, above[k] + inward, 0.45 * self.leg_m, steel, f"diagonal {level}")
                    )
        plate = self.top_m / 2 + self.leg_m
        top = foot + self.height_m + 0.3 * self.leg_m
        solids.append(block((-plate, -plate, top), (plate, plate, top + 0.05), steel, "platform"))
        return BuiltStructure(structure_of(solids), cover_all(solids))

    def _ring(self, z: float, foot: float) -> Array:
        half = (self.base_m + (self.top_m - self.base_m) * (z - foot) / self.height_m) / 2
        return np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])

    def _bar(self, a: Array, b: Array, width: float, material: materials.Material, name: str) -> Solid:
        h = width / 2
        return prism(np.array([(-h, -h), (h, -h), (h, h), (-h, h)]), a, b, material, name)
