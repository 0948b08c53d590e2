"""Input of the renderer: textured triangle meshes, static or moving, and lights."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import Indices, Structure
from uavbench.trajectories.pose import Array, Pose

Streams = Callable[..., np.random.Generator]
"""The random stream of the given names: see `random_streams.stream`."""

STRUCTURE = 1
"""Value of the structure in the instance mask."""

Texture = NDArray[np.uint8]
"""Image RGB or RGBA (h, w, 3 or 4), row 0 at v = 1."""


@dataclass(frozen=True, eq=False)
class Film:
    """Water on the ground, as a texture (h, w, 3) that repeats every tile_m metres in the world's x and y.

    Red is the share of damp ground, green that of standing water, which mirrors the scene on ground at z = 0 if any
    stands.
    """

    texture: Texture
    tile_m: float
    stands: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """One mesh with one material, in the world frame (metres, z up).

    vertices (n, 3); triangles (m, 3) counter-clockwise from outside; unit normals (n, 3) for smooth shading, or None
    for flat shading; uv (n, 2) in texture units; texture coded as the square root of linear albedo, repeated outside
    0..1, with an alpha mask as its fourth channel; tint (n, 4), per vertex, a factor on the albedo and the visible
    fraction of the lamp; roughness 0.04..1; two_sided for leaves and cloth; lightmap requests baked light in a texture
    of its own (for a parallelogram of two triangles); ripples makes the part level water that mirrors the scene, with
    slopes (R along x, G along y, zero at 128, RIPPLE_SLOPE per unit); distant parts cast shadows through a map of their
    own, which leaves that of the others as fine as it is; film wets the part; soil, at soil_uv (n, 2), is a texture of
    factors on the albedo; an alpha mask that keeps_cover covers as much from afar, where the mean of blades and gaps
    would be all gap; instance is its value in the instance mask (0: obstacles, STRUCTURE); name identifies the
    piece of the structure.
    """

    vertices: Array
    triangles: Indices
    normals: Array | None = None
    uv: Array | None = None
    texture: Texture | None = None
    tint: Array | None = None
    roughness: float = 0.8
    two_sided: bool = False
    casts_shadow: bool = True
    distant: bool = False
    lightmap: bool = False
    ripples: Texture | None = None
    film: Film | None = None
    soil: Texture | None = None
    soil_uv: Array | None = None
    keeps_cover: bool = False
    name: str = ""
    instance: int = 0

    @property
    def cutout(self) -> bool:
        """Whether the texture has an alpha mask."""
        return self.texture is not None and self.texture.shape[2] == 4


def plain(part: Part) -> Part:
    """The part in the mean colour of its texture; unchanged where the texture has an alpha mask."""
    if part.texture is None or part.cutout:
        return part
    mean = np.sqrt(np.square(part.texture.astype(np.float64)).mean(axis=(0, 1)))
    return replace(part, texture=np.rint(mean).astype(np.uint8)[None, None])


@dataclass(frozen=True, eq=False)
class Mover:
    """A moving part; `world_from_part` maps a time in seconds to its pose."""

    part: Part
    world_from_part: Callable[[float], Pose]


@dataclass(frozen=True, kw_only=True)
class Roadway:
    """The road that a structure carries along x through its centre: half its width between kerbs, and its level.

    The structure extends half_length_m from its centre, front_m at ground level.
    """

    half_width_m: float
    level_m: float
    half_length_m: float
    front_m: float


@dataclass(frozen=True, eq=False)
class BuiltStructure:
    """A structure as designed, which trackers get, and as built, which is rendered.

    parts are as built; deviation records the differences by name; road is the one that it carries, None for most; doors
    (n, 2, 2) are the ends of each on the ground, counter-clockwise around the structure as designed, metres.
    """

    structure: Structure
    parts: tuple[Part, ...]
    deviation: dict[str, float | str] = field(default_factory=dict)
    road: Roadway | None = None
    doors: Array = field(default_factory=lambda: np.zeros((0, 2, 2)))


@dataclass(frozen=True, eq=False)
class CloudShadow:
    """Light of the lamp that passes the clouds: red of a texture (h, w, 3), 255 for all of it.

    The texture repeats every tile_m metres in the plane across the lamp's direction, and moves at wind_m_s (x, y, z).
    """

    texture: Texture
    tile_m: float
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Light:
    """Light of a scene, linear RGB: one distant lamp (the sun) that casts shadows, and hemispherical ambient light.

    to_lamp is the direction towards the lamp; shadow_map renders its shadows (otherwise they are baked into the tints);
    softness_m is the width of the penumbra; haze_per_m the extinction coefficient of the haze; clouds dim the lamp.
    """

    to_lamp: tuple[float, float, float]
    lamp: tuple[float, float, float]
    above: tuple[float, float, float]
    below: tuple[float, float, float]
    shadow_map: bool = True
    softness_m: float = 0.01
    haze_per_m: float = 0.0
    haze_color: tuple[float, float, float] = (0.7, 0.8, 0.9)
    clouds: CloudShadow | None = None


def nowhere(points: Array) -> NDArray[np.bool_]:
    """Mask (n,) of points (n, 2 or 3) that accepts none."""
    return np.zeros(len(points), dtype=bool)


@dataclass(frozen=True, eq=False)
class BuiltSite:
    """Ground that is shaped to a structure.

    parts are drawn in addition to the environment's; structure replaces the parts of the structure; height maps points
    (n, 2) to the height of the ground, is_free to whether clutter may stand there; shades: the ground too occludes
    ambient light; is_hidden tells of viewpoints (n, 3) whether a neighbouring building contains them or hides the
    structure from them; clouds cast shadows on all of the scene.
    """

    parts: tuple[Part, ...]
    structure: tuple[Part, ...]
    height: Callable[[Array], Array]
    is_free: Callable[[Array], NDArray[np.bool_]]
    shades: bool = False
    is_hidden: Callable[[Array], NDArray[np.bool_]] = nowhere
    clouds: CloudShadow | None = None


@dataclass(frozen=True, eq=False)
class Room:
    """A square room above the floor: its side and height, m; turn (3, 3) and place (3,) of its middle in the world."""

    side_m: float
    height_m: float
    turn: Array
    place: Array

    def to_walls(self, points: Array) -> Array:
        """Distance (n,) of points (n, 3) in the world to the nearest wall or the ceiling, m; negative outside."""
        x, y, z = ((points - self.place) @ self.turn).T
        to_walls: Array = np.minimum(0.5 * self.side_m - np.maximum(np.abs(x), np.abs(y)), self.height_m - z)
        return to_walls


@dataclass(frozen=True)
class Confines:
    """What limits where a flight may go in an environment: the site and the room around a structure, if any."""

    site: BuiltSite | None = None
    room: Room | None = None


@dataclass(frozen=True, eq=False)
class BuiltEnvironment:
    """Ground, walls and light around a structure; sky is a panorama (h, 2h, 3) or None indoors.

    The panorama is square-root coded. Its columns run from azimuth -180 to 180 degrees (world x is 0), its rows from
    the zenith down. Without textures each part of the structure has the mean colour of its texture; sharp ones take
    finer mipmaps. grain is the standard deviation of the log albedo of all surfaces in each octave. site shapes the
    ground to the structure, None for level ground; its second argument is the generator of each stream that it names.
    room: that around everything, None outdoors.
    """

    parts: tuple[Part, ...]
    light: Light
    sky: Texture | None = None
    textures: bool = True
    sharp: bool = False
    grain: float = 0.0
    site: Callable[[BuiltStructure, Streams], BuiltSite] | None = None
    room: Room | None = None


@dataclass(frozen=True, eq=False)
class BuiltClutter:
    """Static and moving objects that do not belong to the structure."""

    parts: tuple[Part, ...] = ()
    movers: tuple[Mover, ...] = ()
