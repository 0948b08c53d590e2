"""Parameters of a site, and its adaptation to the structure that stands on it."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.solids import block, covered, prism, subdivided
from uavbench.scenes.renderables import BuiltSite, BuiltStructure, Part, Roadway, Streams
from uavbench.scenes.site import plants, water
from uavbench.scenes.site.clouds import cloud_shadow
from uavbench.scenes.site.dirt import dirtied
from uavbench.scenes.site.film import film
from uavbench.scenes.site.neighbours import neighbours
from uavbench.scenes.site.roads import Carriageway, marked, paint
from uavbench.scenes.site.terrain import BANK_SLOPE, BED_M, FAR_M, GRASSED_M, SHOULDER_M, Course, Embankment, Terrain
from uavbench.trajectories.errors import UserError, refuse_idle
from uavbench.trajectories.pose import Array

LOW_M = 0.3
"""Pieces of a structure that reach below this height, metres, count as standing on the ground."""
RIVER_SHARE = 0.62
"""Width of a river between the crests of its banks, as a fraction of the distance between the outermost footprints."""
LANE_M = 3.5
"""Lane width of a rural road, metres (AASHTO Green Book 2018, section 4.3: 2.7 to 3.6 m)."""
ROADSIDE_M = 0.8
"""Least distance from the edge of a road to the nearest footprint, metres."""
PLINTH_M = 0.45
"""Overhang of a footing beyond the piers on it, metres."""
CONTACT_M = (0.1, 0.4, 1.2)
"""Distances from footprints at which the ground mesh has vertices for their contact shadow, metres."""
WALL_CUT_M, WALL_HIGH_M = 0.5, 1.5
"""Longest side of the structure's triangles in the zone of contact shadows, and the height of that zone, metres."""


TONE = 0.08
"""Standard deviation of the ground's relative brightness between vertices."""


@dataclass(frozen=True)
class Site:
    """Site around a structure outdoors; each detail is off by default and drawn from the sequence's seed.

    beneath: what passes under the structure along y, a river WATER_M below its banks or a road with markings;
    embankments carry the structure's road up to both ends; markings are painted on that road; plants is the density of
    grass along footprints and reeds along water (0: none, 1: an unmaintained site); contact_shadows bakes ambient
    occlusion near the ground on a finer mesh; neighbours is the number of buildings around the structure, at least
    neighbours_from_m metres from its bounds; cloud_shadow is the share of the sun's beam in the shadow of clouds of
    cloud_size_m metres, which drift at wind_m_s; wet is the share of the ground that is wet; dirt soils the
    structure's facades (0: clean, 1: never cleaned). A site is not part of the structure's model: its value in the
    instance mask is 0, that of plants 2.
    """

    beneath: Literal["ground", "river", "road"] = "ground"
    embankments: bool = False
    markings: bool = False
    plants: Annotated[float, Interval(ge=0, le=5)] = 0.0
    contact_shadows: bool = False
    neighbours: Annotated[int, Interval(ge=0, le=40)] = 0
    neighbours_from_m: Annotated[float, Interval(ge=5, le=60)] = 25.0
    cloud_shadow: Annotated[float, Interval(ge=0, le=1)] = 0.0
    cloud_size_m: Annotated[float, Interval(ge=10, le=2000)] = 150.0
    wind_m_s: Annotated[float, Interval(ge=0, le=40)] = 0.0
    wet: Annotated[float, Interval(ge=0, le=1)] = 0.0
    dirt: Annotated[float, Interval(ge=0, le=1)] = 0.0

    def __post_init__(self) -> None:
        refuse_idle(self, {"neighbours_from_m": ("neighbours",), "cloud_size_m": ("cloud_shadow",)})

    def build(self, ground: Material, built: BuiltStructure, streams: Streams) -> BuiltSite:
        """The site around a structure; ground is the material of the level ground.

        Neighbours, plants, clouds, water and dirt have random streams of their own: adding one leaves the others as
        they are.
        UserError when embankments or markings are set for a structure without a road, or no road fits beneath it, or
        there is no room for the neighbours.
        """
        rng = streams()
        terrain = self._terrain(built, rng)
        bounds = built.structure.bounds
        shared = _Shared(ground, materials.gravel(rng), materials.asphalt(rng), materials.concrete(rng))
        parts = _ground_parts(terrain, shared, rng)
        if self.beneath == "river" and terrain.course is not None:
            parts += [water.surface(terrain, rng), *_plinths(built, terrain, shared.concrete)]
        if self.beneath == "road" and terrain.course is not None:
            parts += _road_beneath(terrain.course, shared.asphalt)
        structure = built.parts
        if built.road is not None and self.markings:
            structure = marked(structure, built.road, shared.asphalt)
        if built.road is not None and self.embankments:
            parts += self._approaches(built.road, bounds, shared)
        if self.plants > 0:
            parts += _plants(terrain, built.doors, self.plants, streams)
        if self.contact_shadows:
            structure = tuple(_cut_low(part) for part in structure)
        if self.wet > 0:
            parts = _wetted(parts, shared, self.wet, streams("water"))
        if self.dirt > 0:
            structure = dirtied(structure, self.dirt, streams("dirt"))
        site = BuiltSite(tuple(parts), structure, terrain.height, terrain.is_free, self.contact_shadows)
        if self.cloud_shadow > 0:
            clouds = cloud_shadow(self.cloud_shadow, self.cloud_size_m, self.wind_m_s, streams("clouds"))
            site = replace(site, clouds=clouds)
        return site if self.neighbours == 0 else self._with_neighbours(site, terrain, built.road, streams("neighbours"))

    def _with_neighbours(
        self, site: BuiltSite, terrain: Terrain, road: Roadway | None, rng: np.random.Generator
    ) -> BuiltSite:
        beside = neighbours(self.neighbours, self.neighbours_from_m, terrain, road, rng)
        return replace(
            site,
            parts=(*site.parts, *beside.parts),
            is_free=lambda points: terrain.is_free(points) & ~beside.covers(points),
            is_hidden=beside.hides,
        )

    def layout(self, built: BuiltStructure, streams: Streams) -> BuiltSite:
        """The ground and neighbours of `build`, with the same errors, without parts to draw."""
        terrain = self._terrain(built, streams())
        site = BuiltSite((), built.parts, terrain.height, terrain.is_free)
        return site if self.neighbours == 0 else self._with_neighbours(site, terrain, built.road, streams("neighbours"))

    def _terrain(self, built: BuiltStructure, rng: np.random.Generator) -> Terrain:
        if (self.embankments or self.markings) and built.road is None:
            raise UserError("environment.site: embankments and markings need a structure that carries a road: a bridge")
        feet = _feet(built.parts)
        embankment = Embankment.of(built.road) if self.embankments and built.road is not None else None
        contact = CONTACT_M if self.contact_shadows else ()
        return Terrain(built.structure.bounds, feet, self._course(built, feet, rng), embankment, contact)

    def _course(self, built: BuiltStructure, feet: Array, rng: np.random.Generator) -> Course | None:
        if self.beneath == "ground":
            return None
        low, high = built.structure.bounds[:, 0]
        outer = feet[(feet[:, 1, 0] - feet[:, 0, 0] < 0.5 * (high - low))]
        left, right = _clear(outer, (low, high))
        if self.beneath == "river":
            half = RIVER_SHARE * (right - left) / 2
            straight = float(np.abs(built.structure.bounds[:, 1]).max()) + 6.0
            bends = rng.uniform([2.0, 0.02, 0.0], [7.0, 0.05, 2 * np.pi], (2, 3)).tolist()
            waves = tuple((metres, per_m, phase) for metres, per_m, phase in bends)
            return Course("river", (left + right) / 2, half, straight, waves)
        a, b = _widest_gap(outer, left, right)
        half = min(LANE_M + 0.5, (b - a) / 2 - ROADSIDE_M)
        if half < 1.5:
            raise UserError("environment.site.beneath: no gap beneath the structure is wide enough for a road")
        return Course("road", (a + b) / 2, half)

    def _approaches(self, road: Roadway, bounds: Array, shared: "_Shared") -> list[Part]:
        """The approach roads at both ends of the structure, and the wing walls that retain the fill up to its crest."""
        parts: list[Part] = []
        wide = float(np.abs(bounds[:, 1]).max())
        start = Embankment.of(road).start_m
        white = paint()
        for side in (-1, 1):
            begin = sorted((side * road.half_length_m, side * (start + 0.5)))
            inner = road.half_width_m - 0.02
            fill = block((begin[0], -inner, 0.0), (begin[1], inner, road.level_m - 0.01), shared.concrete)
            parts.append(covered(fill, 0))
            end = float(np.abs(bounds[:, 0]).max())
            if start > end:
                walls = sorted((side * end, side * (start + 0.5)))
                for edge in (-1, 1):
                    rows = sorted((edge * inner, edge * wide))
                    wall = block((walls[0], rows[0], 0.0), (walls[1], rows[1], road.level_m + 0.2), shared.concrete)
                    parts.append(covered(wall, 0))
            way = sorted((side * road.half_length_m, side * 170.0))
            lane = Carriageway(start_m=way[0], end_m=way[1], half_m=road.half_width_m, level_m=road.level_m)
            parts += lane.parts(shared.asphalt, white, self.markings)
        return parts


@dataclass(frozen=True, eq=False)
class _Shared:
    """Materials shared by the parts of a site."""

    ground: Material
    gravel: Material
    asphalt: Material
    concrete: Material


def _feet(parts: tuple[Part, ...]) -> Array:
    """Footprints (n, 2, 2) of the structure's pieces as lowest and highest (x, y), metres, none inside another."""
    boxes = [p.vertices[p.vertices[:, 2] < LOW_M, :2] for p in parts if p.vertices[:, 2].min() < LOW_M]
    found = np.array([[box.min(axis=0), box.max(axis=0)] for box in boxes]).reshape(-1, 2, 2)
    within = (found[:, None, 0] >= found[None, :, 0] - 1e-6) & (found[:, None, 1] <= found[None, :, 1] + 1e-6)
    inside = within.all(axis=2)
    first = np.arange(len(found))
    again = inside & ~(inside.T & (first[:, None] <= first[None]))
    return found[~again.any(axis=1)]


def _clear(feet: Array, ends: tuple[float, float]) -> tuple[float, float]:
    """Range (low, high) along x between the end supports, in which only intermediate footprints lie."""
    middle = sum(ends) / 2
    left = max((float(b) for b in feet[:, 1, 0] if b < middle - 0.25 * (ends[1] - ends[0])), default=float(ends[0]))
    right = min((float(a) for a in feet[:, 0, 0] if a > middle + 0.25 * (ends[1] - ends[0])), default=float(ends[1]))
    return left, right


def _widest_gap(feet: Array, left: float, right: float) -> tuple[float, float]:
    """The widest interval along x without footprints."""
    stops = [(float(a), float(b)) for (a, _), (b, _) in feet if b > left and a < right]
    at, best = left, (left, left)
    for a, b in [*sorted(stops), (right, right)]:
        if a - at > best[1] - best[0] + 1e-6:
            best = (at, a)
        at = max(at, b)
    return best


def _ground_parts(terrain: Terrain, shared: _Shared, rng: np.random.Generator) -> list[Part]:
    """The ground mesh: gravel along roads and under water, elsewhere the material of the environment."""
    vertices, triangles = terrain.mesh()
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, triangles[:, k], faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    middle = ((a + b + c) / 3)[:, :2]
    stony: NDArray[np.bool_] = np.zeros(len(triangles), dtype=bool)
    if (course := terrain.course) is not None:
        reach = course.half_m + SHOULDER_M if course.kind == "road" else course.half_m - BANK_SLOPE * GRASSED_M
        stony |= course.across(middle) < reach
    if (bank := terrain.embankment) is not None:
        stony |= (np.abs(middle[:, 0]) > bank.start_m) & (np.abs(middle[:, 1]) < bank.half_m)
    tone = 1 + TONE * terrain.tones(rng)[:, None] * [1.0, 1.0, 1.0, 0.0]
    out = []
    for look, chosen in ((shared.ground, ~stony), (shared.gravel, stony)):
        if chosen.any():
            used, index = np.unique(triangles[chosen], return_inverse=True)
            out.append(
                Part(
                    vertices=vertices[used],
                    triangles=index.reshape(-1, 3),
                    normals=normals[used],
                    uv=vertices[used, :2] / np.array(look.tile_m),
                    texture=look.texture,
                    tint=tone[used],
                    roughness=1.0,
                    casts_shadow=False,
                )
            )
    return out


def _plinths(built: BuiltStructure, terrain: Terrain, concrete: Material) -> list[Part]:
    """Footings of piers in the water, from the bed to the level ground, with pointed cutwaters along the current."""
    groups: dict[str, list[Array]] = {}
    for part in built.parts:
        low = part.vertices[part.vertices[:, 2] < LOW_M, :2]
        if len(low) and terrain.height(low.mean(axis=0, keepdims=True))[0] < 0:
            groups.setdefault(part.name, []).append(low)
    out = []
    for places in groups.values():
        at = np.concatenate(places)
        (x0, y0), (x1, y1) = at.min(axis=0) - PLINTH_M, at.max(axis=0) + PLINTH_M
        nose = (x1 - x0) / 2
        profile = [(y0, -x1), (y1, -x1), (y1 + nose, -(x0 + x1) / 2), (y1, -x0), (y0, -x0), (y0 - nose, -(x0 + x1) / 2)]
        solid = prism(np.array(profile), (0.0, 0.0, -BED_M - 0.3), (0.0, 0.0, -0.01), concrete)
        out.append(covered(solid, 0, longest_m=1.0))
    return out


def _road_beneath(course: Course, asphalt: Material) -> list[Part]:
    """A road along y that extends beyond the rim of hills."""
    way = Carriageway(start_m=-FAR_M / 6, end_m=FAR_M / 6, half_m=course.half_m, level_m=0.0)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [
        replace(part, vertices=part.vertices @ turn.T + [course.centre_m, 0.0, 0.0])
        for part in way.parts(asphalt, paint(), marked=True)
    ]


def _wetted(parts: list[Part], shared: _Shared, share: float, rng: np.random.Generator) -> list[Part]:
    """The parts with water on the ground and the roads, but for the markings; it stands on level, hard ground only."""
    standing = film(share, rng)
    sinking = replace(standing, stands=False)
    soaks = {id(shared.ground.texture): shared.ground.soaks, id(shared.gravel.texture): False}
    soaks |= {id(shared.asphalt.texture): False}
    out = []
    for part in parts:
        if id(part.texture) in soaks:
            level = bool((np.abs(part.vertices[:, 2]) < 0.01).any())
            part = replace(part, film=standing if level and not soaks[id(part.texture)] else sinking)
        out.append(part)
    return out


def _plants(terrain: Terrain, doors: Array, density: float, streams: Streams) -> list[Part]:
    """Tufts along footprints, reeds along water."""
    out = []
    for kind, grown, look in (
        ("tufts", partial(plants.at_feet, terrain, doors), plants.tufts),
        ("reeds", partial(plants.at_water, terrain), plants.reeds),
    ):
        rng = streams(kind)
        stand = grown(density, rng)
        if len(stand.places):
            out.append(plants.cards(stand, terrain, look(rng), rng))
    return out


def _cut_low(part: Part) -> Part:
    """The part with its triangles near the ground subdivided."""
    return subdivided(part, WALL_CUT_M, below_m=WALL_HIGH_M)
