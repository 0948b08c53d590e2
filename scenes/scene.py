"""A scene built from a spec: structure, environment and clutter, lit and ready to render."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from uavbench.scenes.clutter.registry import CLUTTER, ON_GROUND
from uavbench.scenes.materials.grain import grained
from uavbench.scenes.own_scene import clutter_same_twice, own_clutter, own_environment, own_structure, same_twice
from uavbench.scenes.primitives.meshes import TriangleMesh, joined, merged
from uavbench.scenes.renderables import (
    BuiltClutter,
    BuiltEnvironment,
    BuiltSite,
    BuiltStructure,
    Confines,
    Light,
    Mover,
    Part,
    Room,
    Texture,
    plain,
)
from uavbench.scenes.rendering.light_baking import bake, smooth_corners
from uavbench.scenes.rendering.renderer import Renderer
from uavbench.scenes.spec import SequenceSpec
from uavbench.scenes.structures.registry import STRUCTURES
from uavbench.scenes.surfaces import SceneSurfaces
from uavbench.scenes.world.registry import ENVIRONMENTS
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream

Placed = TypeVar("Placed")
KEPT = 2
"""Structures and environments that are cached: a flight is rendered or flown several times, or in two surroundings."""
SHADE_M = 20.0
"""Radius around a structure, metres, within which the ground occludes ambient light."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene with baked light, ready to be rendered.

    parts have baked light in their tints; unlit are the same parts without, for a path tracer. lamp_radius is the
    tangent of the lamp's angular radius; site is the ground where it is shaped to the structure; sharp: whether finer
    mipmaps are taken.
    """

    built: BuiltStructure
    parts: tuple[Part, ...]
    unlit: tuple[Part, ...]
    movers: tuple[Mover, ...]
    light: Light
    lamp_radius: float
    sky: Texture | None
    obstacles: ObstacleMesh
    site: BuiltSite | None = None
    sharp: bool = False
    room: Room | None = None

    def renderer(self, width: int, height: int) -> Renderer:
        """A renderer of the scene."""
        return Renderer(self.parts, self.light, width, height, self.movers, self.sky, self.sharp)


def obstacles_of(spec: SequenceSpec) -> ObstacleMesh:
    """Obstacle mesh of a flight: the structure as designed."""
    structure = _unpainted(spec).structure
    return ObstacleMesh(structure.vertices, structure.triangles)


def confines_of(spec: SequenceSpec) -> Confines:
    """The site and the room of a scene that is not built; UserError as `build_scene`, for clutter without room too."""
    built = _unpainted(spec)
    bounds = built.structure.bounds
    parts, _ = spec.deviation.apply(built.parts, bounds, stream(spec.seed, "deviation"))
    built = replace(built, parts=parts)
    confines = _confines(spec, built)
    for number, clutter in enumerate(spec.clutter):
        if type(clutter) not in CLUTTER.values():
            _placed(spec, number, bounds, confines.site)
        elif hasattr(clutter, "check_room"):
            _on_free_ground(spec, number, confines.site, partial(clutter.check_room, bounds))
    return confines


def _confines(spec: SequenceSpec, built: BuiltStructure) -> Confines:
    environment: Any = spec.environment
    rng, streams = stream(spec.seed, "environment"), partial(stream, spec.seed, "site")
    if type(environment) in ENVIRONMENTS.values():
        found: Confines = environment.confines(built, rng, streams)
        return found
    own = _environment(spec, built.structure.bounds)
    return Confines(_site(spec, own, built), own.room)


def build_scene(spec: SequenceSpec) -> Scene:
    """Structure, environment and clutter of a spec, with baked light; deterministic in spec and seed."""
    built = _built(spec)
    bounds = built.structure.bounds
    parts, record = spec.deviation.apply(built.parts, bounds, stream(spec.seed, "deviation"))
    built = replace(built, parts=parts, deviation=record)
    environment = _environment(spec, bounds)
    plainly = not environment.textures
    if plainly:
        built = replace(built, parts=tuple(map(plain, built.parts)))
    site = _site(spec, environment, built)
    if site is not None:
        built = replace(built, parts=site.structure)
        sunlight = replace(environment.light, clouds=site.clouds)
        environment = replace(environment, parts=(*site.parts, *environment.parts), light=sunlight)
    clutter = [_placed(spec, i, bounds, site) for i in range(len(spec.clutter))]
    solid = (*built.parts, *chain.from_iterable(c.parts for c in clutter))
    hiding = [p for p in solid if not p.cutout]
    if site is not None and site.shades:
        hiding += [_near(part, bounds) for part in site.parts if not part.cutout and part.ripples is None]
    occluder = ObstacleMesh(*joined(TriangleMesh(p.vertices, p.triangles) for p in hiding))
    reach = min(0.6 * float(np.linalg.norm(bounds[1] - bounds[0])), 3.0)
    still = [p for p in environment.parts if not 1 < p.instance < 10]
    textured = (*built.parts, *still, *(p for p in solid if p.instance >= 10))
    shaded = merged(grained(textured, environment.grain, partial(stream, spec.seed, "grain")))
    drawn = tuple(map(smooth_corners, shaded)) if plainly else bake(shaded, occluder, environment.light, reach)
    growing = merged(p for p in (*environment.parts, *solid) if 1 < p.instance < 10)
    movers = tuple(chain.from_iterable(c.movers for c in clutter))
    everything = (*built.parts, *environment.parts, *chain.from_iterable(c.parts for c in clutter))
    surroundings = SceneSurfaces(everything, movers)
    obstacles = ObstacleMesh(built.structure.vertices, built.structure.triangles, surroundings=surroundings)
    light = environment.light
    return Scene(
        built,
        drawn + growing,
        shaded + growing,
        movers,
        light,
        light.softness_m / reach,
        environment.sky,
        obstacles,
        site,
        environment.sharp,
        environment.room,
    )


def _environment(spec: SequenceSpec, bounds: Array) -> BuiltEnvironment:
    """What the environment of a spec builds around a structure of bounds (2, 3) in metres."""
    environment: Any = spec.environment
    if type(environment) in ENVIRONMENTS.values():
        return _around(environment, spec.seed, bounds.tobytes())

    def build() -> BuiltEnvironment:
        found: BuiltEnvironment = environment.build(bounds.copy(), stream(spec.seed, "environment"))
        return found

    return same_twice(environment, lambda: own_environment(environment, build()))


@lru_cache(maxsize=KEPT)
def _around(environment: Any, seed: int, bounds: bytes) -> BuiltEnvironment:
    """The environment of these parameters around bounds (2, 3) float64, cached: trackers fly through the same one."""
    built: BuiltEnvironment = environment.build(np.frombuffer(bounds).reshape(2, 3), stream(seed, "environment"))
    return built


def _site(spec: SequenceSpec, environment: BuiltEnvironment, built: BuiltStructure) -> BuiltSite | None:
    """The ground of an environment of a spec, shaped to a structure; None where it is level."""
    shaped = environment.site
    if shaped is None:
        return None
    streams = partial(stream, spec.seed, "site")
    if type(spec.environment) in ENVIRONMENTS.values():
        return shaped(built, streams)
    return same_twice(spec.environment, lambda: shaped(built, streams))


def _unpainted(spec: SequenceSpec) -> BuiltStructure:
    """The structure of a spec as designed, for its geometry only; a user's code is called as for `_built`."""
    if type(spec.structure) in STRUCTURES.values():
        structure: Any = spec.structure
        built: BuiltStructure = structure.unpainted()
        return built
    return _built(spec)


def _built(spec: SequenceSpec) -> BuiltStructure:
    """The structure of a spec as designed; one that depends on a file or on a user's code is built on every call."""
    structure = spec.structure
    if type(structure) not in STRUCTURES.values():
        return same_twice(structure, lambda: own_structure(structure, structure.build(stream(spec.seed, "structure"))))
    if hasattr(structure, "entering_files"):
        return structure.build(stream(spec.seed, "structure"))
    hashable: Any = structure  # as a frozen dataclass of numbers is
    return _of_parameters(hashable, spec.seed)


@lru_cache(maxsize=KEPT)
def _of_parameters(structure: Any, seed: int) -> BuiltStructure:
    """The structure of these parameters, cached because flight and rendering of a sequence both need it."""
    built: BuiltStructure = structure.build(stream(seed, "structure"))
    return built


def _placed(spec: SequenceSpec, number: int, bounds: Array, site: BuiltSite | None) -> BuiltClutter:
    """Clutter of a number around the structure, on free ground of the site if there is one; UserError naming it."""
    clutter = spec.clutter[number]
    place = partial(_on_free_ground, spec, number, site)
    if type(clutter) in CLUTTER.values():
        return place(partial(clutter.build, bounds.copy()))
    return clutter_same_twice(clutter, lambda: own_clutter(clutter, place(partial(clutter.build, bounds.copy()))))


def _on_free_ground(spec: SequenceSpec, number: int, site: BuiltSite | None, build: Callable[..., Placed]) -> Placed:
    """What `build` makes of the generator of clutter of a number, and of free ground; UserError naming the clutter."""
    rng = stream(spec.seed, "clutter", number)
    try:
        return (
            build(rng, site.is_free) if site is not None and isinstance(spec.clutter[number], ON_GROUND) else build(rng)
        )
    except UserError as error:
        raise UserError(f"sequence {spec.name}: clutter[{number}]: {error}") from None


def _near(part: Part, bounds: Array) -> Part:
    """The triangles of a part that are near the structure."""
    low, high = bounds[0] - SHADE_M, bounds[1] + SHADE_M
    corners = part.vertices[part.triangles]
    return replace(part, triangles=part.triangles[((corners < high) & (corners > low)).all(axis=(1, 2))])
