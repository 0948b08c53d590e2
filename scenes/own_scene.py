"""Checks of what users' structures, environments and clutter build: no file and no image tells of it later."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from uavbench.scenes.model_files.mesh_checks import closedness
from uavbench.scenes.primitives.meshes import TriangleMesh, joined
from uavbench.scenes.renderables import BuiltClutter, BuiltEnvironment, BuiltSite, BuiltStructure, Light, Mover, Part
from uavbench.scenes.structure import Structure
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array, Pose

STRUCTURE = 1
"""Value of the structure in the instance mask."""
LARGEST_INSTANCE = 255
PIECES = 9
"""Points of each edge at which a structure is compared with the parts that are drawn."""
BESIDE, MOST_BESIDE = 0.05, 0.25
"""Distance of a point from the parts, in largest extents, from which it is beside them, and most of such points.

Deviations as built are a hundredth of a structure; parts in another unit or frame are beside nearly all edges.
"""
BRIGHTEST = 100.0
"""Largest linear radiance of a lamp or the ambient light: the sun of `outdoor` has about 5."""

COMPARED_S = (0.0, 0.5)
"""Times, in s, at which the poses of movers are compared: its start, and one that few sequences are too short for."""

OF_THE_SEED = (
    "take all random numbers from the `rng` that it is given, and nothing from the clock, the order of a set, or an "
    "earlier call"
)

Built = TypeVar("Built", BuiltStructure, BuiltEnvironment, BuiltClutter, BuiltSite)


def same_twice(plugin: object, build: Callable[[], Built]) -> Built:
    """What `build` builds of a user's plug-in; UserError unless it builds the same a second time.

    What depends on more than its parameters and the generator given to it differs in every run of one seed.
    """
    return _built_twice(plugin, build)[0]


def clutter_same_twice(plugin: object, build: Callable[[], BuiltClutter]) -> BuiltClutter:
    """As `same_twice`, of clutter; poses of its movers are compared, too, whenever one is asked for."""
    built, again = _built_twice(plugin, build)
    pairs = zip(built.movers, again.movers, strict=True)
    return BuiltClutter(built.parts, tuple(_compared(plugin, number, *pair) for number, pair in enumerate(pairs)))


def _built_twice(plugin: object, build: Callable[[], Built]) -> tuple[Built, Built]:
    built, again = build(), build()
    if not _alike(built, again):
        raise UserError(f"{_name(plugin)}: build gives something else each time; {OF_THE_SEED}")
    return built, again


def _compared(plugin: object, number: int, mover: Mover, again: Mover) -> Mover:
    """A mover whose poses are those of its second build, and of a second call, at all times that are asked for."""

    def world_from_part(time_s: float) -> Pose:
        pose = mover.world_from_part(time_s)
        for other in (again, mover):
            if not np.array_equal(pose.matrix, other.world_from_part(time_s).matrix):
                raise UserError(
                    f"clutter {_name(plugin)}: movers[{number}]: world_from_part gives two poses for {time_s:.3f} s; "
                    "draw random numbers in build, and keep nothing from an earlier call"
                )
        return pose

    return replace(mover, world_from_part=world_from_part)


def _alike(one: Any, other: Any) -> bool:
    """Whether two values are equal, with the arrays in them and the ways of movers; other functions are taken to be."""
    if isinstance(one, np.ndarray):
        same = isinstance(other, np.ndarray) and (one.dtype, one.shape) == (other.dtype, other.shape)
        return same and one.tobytes() == other.tobytes()
    if type(one) is not type(other):
        return False
    if isinstance(one, Mover) and not all(
        _alike(one.world_from_part(t).matrix, other.world_from_part(t).matrix) for t in COMPARED_S
    ):
        return False
    if is_dataclass(one):
        return all(_alike(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(_alike, one, other))
    return not isinstance(one, str | int | float) or bool(one == other or (one != one and other != other))


def own_structure(plugin: object, found: Any) -> BuiltStructure:
    """What a user's structure built; UserError unless trackers' edges lie on the parts that are drawn."""
    who = f"structure {_name(plugin)}"
    built = _of_type(who, found, BuiltStructure)
    if not isinstance(built.structure, Structure):
        raise UserError(f"{who}: build gives a BuiltStructure of a {_kind(built.structure)}; it takes a Structure")
    vertices = built.structure.vertices
    if not np.isfinite(vertices).all() or not len(built.structure.edges):
        raise UserError(f"{who}: its Structure has no edges, or vertices that are not finite")
    open_edges, volume = closedness(vertices, built.structure.triangles)
    if volume < 0 and not open_edges:
        raise UserError(f"{who}: its Structure is inside out; list the vertices of triangles counter-clockwise")
    built = replace(built, parts=_parts(who, built.parts))
    if not any(part.instance == STRUCTURE for part in built.parts):
        raise UserError(f"{who}: none of its parts has instance = 1, that of the structure")
    drawn = [TriangleMesh(part.vertices, part.triangles) for part in built.parts]
    ends = built.structure.edge_segments
    points = ends[:, None, 0] + np.linspace(0, 1, PIECES)[None, :, None] * (ends[:, None, 1] - ends[:, None, 0])
    far_m = BESIDE * float(np.ptp(vertices, axis=0).max())
    beside = float((ObstacleMesh(*joined(drawn)).distance(points.reshape(-1, 3)) > far_m).mean())
    if beside > MOST_BESIDE:
        raise UserError(
            f"{who}: {beside:.0%} of the edges that trackers get lie more than {far_m:.3g} m beside the parts that are "
            "drawn; give both in metres and in the same frame"
        )
    return built


def own_environment(plugin: object, found: Any) -> BuiltEnvironment:
    """What a user's environment built; UserError for parts or light that cannot be drawn."""
    who = f"environment {_name(plugin)}"
    built = _of_type(who, found, BuiltEnvironment)
    _check_light(who, built.light)
    if built.sky is not None and not _is_image(built.sky, (3,)):
        raise UserError(f"{who}: its sky is {_kind(built.sky)}; it takes uint8 (h, 2h, 3)")
    return replace(built, parts=_outside(who, built.parts))


def own_clutter(plugin: object, found: Any) -> BuiltClutter:
    """What a user's clutter built; UserError for parts that cannot be drawn, or that count as the structure."""
    who = f"clutter {_name(plugin)}"
    built = _of_type(who, found, BuiltClutter)
    movers = tuple(built.movers)
    for number, mover in enumerate(movers):
        if not isinstance(mover, Mover):
            raise UserError(f"{who}: movers[{number}] is a {_kind(mover)}; it takes a Mover")
        one, other = mover.world_from_part(0.0), mover.world_from_part(0.0)
        if not isinstance(one, Pose):
            raise UserError(f"{who}: movers[{number}]: world_from_part gives a {_kind(one)}; it takes a Pose")
        if not np.array_equal(one.matrix, other.matrix):
            raise UserError(
                f"{who}: movers[{number}]: world_from_part gives two poses for one time; draw random numbers in build"
            )
    parts, moving = _outside(who, built.parts), _outside(f"{who}: movers", tuple(mover.part for mover in movers))
    return BuiltClutter(parts, tuple(replace(mover, part=part) for mover, part in zip(movers, moving, strict=True)))


def _name(plugin: object) -> str:
    return f"{type(plugin).__module__}:{type(plugin).__name__}"


def _kind(found: object) -> str:
    """The type of a value, and of an array its type and shape."""
    return f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__


def _of_type(who: str, found: Any, kind: type[Built]) -> Built:
    if not isinstance(found, kind):
        raise UserError(f"{who}: build gives a {_kind(found)}; it takes a {kind.__name__}")
    return found


def _outside(who: str, parts: Any) -> tuple[Part, ...]:
    """Parts that do not belong to the structure."""
    checked = _parts(who, parts)
    for number, part in enumerate(checked):
        if part.instance == STRUCTURE:
            raise UserError(f"{who}: parts[{number}]: instance = 1 is the structure's; clutter has 2 to 255, ground 0")
    return checked


def _parts(who: str, parts: Any) -> tuple[Part, ...]:
    """Parts as a tuple, without those of no triangles; UserError naming the first that cannot be drawn."""
    try:
        each = tuple(parts)
    except TypeError:
        raise UserError(f"{who}: its parts are a {_kind(parts)}; they take a tuple of Part") from None
    for number, part in enumerate(each):
        if not isinstance(part, Part):
            raise UserError(f"{who}: parts[{number}] is a {_kind(part)}; it takes a Part")
        for fault in _faults(part):
            raise UserError(f"{who}: parts[{number}]{f' ({part.name})' if part.name else ''}: {fault}")
    return tuple(part for part in each if len(part.triangles))


def _faults(part: Part) -> Iterator[str]:
    count = len(part.vertices) if _is_table(part.vertices, 3) else -1
    if count < 0:
        yield f"its vertices are {_kind(part.vertices)}; they take finite numbers (n, 3)"
    corners: Any = part.triangles
    if not (isinstance(corners, np.ndarray) and corners.ndim == 2 and corners.shape[1] == 3):
        yield f"its triangles are {_kind(corners)}; they take integers (m, 3)"
    if len(corners) and not (np.issubdtype(corners.dtype, np.integer) and 0 <= corners.min() <= corners.max() < count):
        yield f"its triangles are {_kind(corners)}; they take integers from 0 to {count - 1}, of its vertices"
    for name, columns in (("normals", 3), ("uv", 2), ("tint", 4), ("soil_uv", 2)):
        given = getattr(part, name)
        if given is not None and not (_is_table(given, columns) and len(given) == count):
            yield f"its {name} are {_kind(given)}; they take finite numbers ({count}, {columns}), one row a vertex"
    for name in ("texture", "soil", "ripples"):
        image = getattr(part, name)
        if image is not None and not _is_image(image, (3, 4)):
            yield f"its {name} is {_kind(image)}; it takes uint8 (h, w, 3 or 4)"
    if not isinstance(part.instance, int | np.integer) or not 0 <= part.instance <= LARGEST_INSTANCE:
        yield f"instance = {part.instance!r}: must be a whole number from 0 to {LARGEST_INSTANCE}"


def _is_table(found: Any, columns: int) -> bool:
    return (
        isinstance(found, np.ndarray)
        and found.ndim == 2
        and found.shape[1] == columns
        and np.issubdtype(found.dtype, np.number)
        and bool(np.isfinite(found).all())
    )


def _is_image(found: Any, channels: tuple[int, ...]) -> bool:
    return isinstance(found, np.ndarray) and found.dtype == np.uint8 and found.ndim == 3 and found.shape[2] in channels


def _check_light(who: str, light: Any) -> None:
    if not isinstance(light, Light):
        raise UserError(f"{who}: its light is a {_kind(light)}; it takes a Light")
    for name in ("lamp", "above", "below", "haze_color"):
        values = _three(getattr(light, name))
        if values is None or values.min() < 0 or values.max() > BRIGHTEST:
            raise UserError(
                f"{who}: light.{name} = {getattr(light, name)}: must be three numbers of linear light from 0 to "
                f"{BRIGHTEST:g}; a white surface in light of 1 is white"
            )
    way = _three(light.to_lamp)
    if way is None or not np.linalg.norm(way) > 0:
        raise UserError(
            f"{who}: light.to_lamp = {light.to_lamp}: must be a direction, three numbers that are not all 0"
        )


def _three(values: Any) -> Array | None:
    try:
        found = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return found if found.shape == (3,) and np.isfinite(found).all() else None
