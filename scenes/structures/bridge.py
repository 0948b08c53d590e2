"""A girder bridge: deck with kerbs and railing, steel girders with cross frames, piers with caps, abutments."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import Solid, block, circle, cover_all, prism, structure_of
from uavbench.scenes.renderables import BuiltStructure, Roadway
from uavbench.trajectories.pose import Array

SLAB_M = 0.25
KERB_M = (0.35, 0.20)
GIRDER_M = 0.9
CAP_M = 0.7
ROAD_M = 0.06
FRONT_M = 0.6
"""Distance from the front of an abutment to the end of the deck, metres."""


@dataclass(frozen=True)
class Bridge:
    """A road bridge along x over level ground, its middle above the origin."""

    length_m: Annotated[float, Gt(4), Interval(le=200)] = 24.0
    width_m: Annotated[float, Gt(2), Interval(le=40)] = 6.0
    clearance_m: Annotated[float, Gt(1), Interval(le=50)] = 4.0
    spans: Annotated[int, Interval(ge=1, le=12)] = 2
    girders: Annotated[int, Interval(ge=2, le=10)] = 4
    railing: bool = True

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The bridge in concrete, asphalt and painted steel, with its roadway."""
        steel, rail = materials.painted_steel(rng), materials.painted_steel(rng, (150.0, 156.0, 158.0), rust=0.5)
        return self._of(steel, rail, materials.concrete(rng), materials.asphalt(rng))

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._of(*(materials.UNPAINTED,) * 4)

    def _of(self, steel: Material, rail: Material, concrete: Material, road: Material) -> BuiltStructure:
        solids = [*self._deck(concrete, road), *self._girders(steel), *self._frames(steel)]
        solids += [*self._piers(concrete), *self._abutments(concrete)]
        if self.railing:
            solids += self._railing(rail)
        return BuiltStructure(structure_of(solids), cover_all(solids), road=self._roadway)

    @property
    def _roadway(self) -> Roadway:
        x = self.length_m / 2
        level = self._under_deck + SLAB_M + ROAD_M
        return Roadway(
            half_width_m=self.width_m / 2 - KERB_M[0], level_m=level, half_length_m=x + 0.5, front_m=x - FRONT_M
        )

    @property
    def _under_deck(self) -> float:
        return self.clearance_m + GIRDER_M

    def _deck(self, concrete: Material, road: Material) -> list[Solid]:
        x, y, z = self.length_m / 2, self.width_m / 2, self._under_deck
        wide, high = KERB_M
        profile = [(-y, 0), (y, 0), (y, SLAB_M + high), (y - wide, SLAB_M + high), (y - wide, SLAB_M)]
        profile += [(-y + wide, SLAB_M), (-y + wide, SLAB_M + high), (-y, SLAB_M + high)]
        slab = prism(np.array(profile), (-x, 0, z), (x, 0, z), concrete, "deck")
        surface = block((-x, -y + wide, z + SLAB_M), (x, y - wide, z + SLAB_M + ROAD_M), road, "road")
        return [slab, surface]

    def _girder_lines(self) -> Array:
        return np.linspace(-1, 1, self.girders) * (self.width_m / 2 - 0.7)

    def _girders(self, steel: Material) -> list[Solid]:
        x, z, flange, web = self.length_m / 2 - 0.3, self.clearance_m, 0.18, 0.012
        profile = np.array(
            [(-flange, 0), (flange, 0), (flange, 0.03), (web, 0.03), (web, GIRDER_M - 0.03), (flange, GIRDER_M - 0.03),
             (flange, GIRDER_M), (-flange, GIRDER_M), (-flange, GIRDER_M - 0.03), (-web, GIRDER_M - 0.03),
             (-web, 0.03), (-flange, 0.03)]
        )  # fmt: skip
        return [prism(profile, (-x, y, z), (x, y, z), steel, f"girder {k}") for k, y in enumerate(self._girder_lines())]

    def _frames(self, steel: Material) -> list[Solid]:
        """Cross frames between adjacent girders, two chords with K bracing, and web stiffeners."""
        out = []
        lines = self._girder_lines()
        count = max(2, round(self.length_m / 4.0))
        low, high = self.clearance_m + 0.12, self.clearance_m + GIRDER_M - 0.14
        angle = np.array([(-0.04, -0.04), (0.04, -0.04), (0.04, 0.04), (-0.04, 0.04)])
        for k, x in enumerate(np.linspace(-1, 1, count) * (self.length_m / 2 - 0.8)):
            for a, b in zip(lines[:-1] + 0.02, lines[1:] - 0.02, strict=True):
                middle = (a + b) / 2
                for (y0, z0), (y1, z1) in (
                    ((a, low), (b, low)),
                    ((a, high), (b, high)),
                    ((a, low), (middle, high)),
                    ((b, low), (middle, high)),
                ):
                    out.append(prism(angle, (x, y0, z0), (x, y1, z1), steel, f"frame {k}"))
            for y in lines:
                z0, z1 = self.clearance_m + 0.031, self.clearance_m + GIRDER_M - 0.031
                for side in (-1, 1):
                    low_y, high_y = sorted((y + side * 0.0125, y + side * 0.16))
                    out.append(block((x + 0.05, low_y, z0), (x + 0.062, high_y, z1), steel, "stiffener"))
        return out

    def _piers(self, concrete: Material) -> list[Solid]:
        out = []
        for k in range(1, self.spans):
            x, y, z = (k / self.spans - 0.5) * self.length_m, self.width_m / 2 - 0.2, self.clearance_m
            taper = np.array([(-y + 0.6, -CAP_M), (y - 0.6, -CAP_M), (y, -0.35), (y, -0.08), (-y, -0.08), (-y, -0.35)])
            out.append(prism(taper, (x - 0.5, 0, z), (x + 0.5, 0, z), concrete, f"cap {k}"))
            for side in (-1, 1):
                foot = (x, side * (y - 1.0), 0.0)
                out.append(prism(circle(0.38, 20), foot, (x, foot[1], z - CAP_M), concrete, f"pier {k}"))
            for line in self._girder_lines():
                out.append(block((x - 0.2, line - 0.2, z - 0.08), (x + 0.2, line + 0.2, z), concrete, "bearing"))
        return out

    def _abutments(self, concrete: Material) -> list[Solid]:
        out = []
        x, y, z = self.length_m / 2, self.width_m / 2, self.clearance_m
        for side in (-1, 1):
            near, far = side * (x - FRONT_M), side * (x + 0.5)
            out.append(block((min(near, far), -y, 0), (max(near, far), y, z - 0.02), concrete, "abutment"))
            back = sorted((side * (x + 0.02), side * (x + 0.5)))
            out.append(block((back[0], -y, z - 0.02), (back[1], y, z + GIRDER_M + SLAB_M), concrete, "back wall"))
            wing = sorted((side * (x + 0.5), side * (x + 3.0)))
            for edge in (-1, 1):
                rows = sorted((edge * y, edge * (y - 0.4)))
                out.append(block((wing[0], rows[0], 0), (wing[1], rows[1], z + 0.6 * GIRDER_M), concrete, "wing"))
        return out

    def _railing(self, rail: Material) -> list[Solid]:
        out = []
        z = self._under_deck + SLAB_M + KERB_M[1]
        posts = max(2, round(self.length_m / 2.0)) + 1
        for y in (-self.width_m / 2 + 0.15, self.width_m / 2 - 0.15):
            for x in np.linspace(-1, 1, posts) * (self.length_m / 2 - 0.2):
                out.append(block((x - 0.04, y - 0.04, z), (x + 0.04, y + 0.04, z + 1.0), rail, "post"))
            half = self.length_m / 2
            for low, thick in ((0.35, 0.05), (0.68, 0.05), (1.0, 0.09)):
                out.append(block((-half, y - 0.035, z + low), (half, y + 0.035, z + low + thick), rail, "rail"))
        return out
