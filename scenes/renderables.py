"""Input of the renderer: textured triangle meshes, static or moving, and the lights."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.structure import Indices, Structure
from uavbench.trajectories.pose import Array, Pose

Texture = NDArray[np.uint8]
"""Image RGB or RGBA (h, w, 3 or 4), row 0 at v = 1."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """One mesh with one material, in the world frame (metres, z up).

    vertices (n, 3); triangles (m, 3) counter-clockwise from outside; normals (n, 3) unit, for smooth shading, or
    None for one normal per triangle; uv (n, 2) in texture units; texture coded as the square root of linear albedo,
    repeated outside 0..1, its fourth channel cuts holes; tint (n, 4) factor on the albedo at each vertex, and the share
    of the lamp seen there; roughness 0.04..1; two_sided for leaves and cloth; lightmap asks for baked light in a
    texture of its own (a parallelogram of two triangles); ripples makes it level water that mirrors the scene, with
    slopes (R along x, G along y, 128 is none, RIPPLE_SLOPE a unit); instance is the value of the part in the instance
    mask (0: obstacles, 1: the structure); name says which piece of the structure it is.
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
    lightmap: bool = False
    ripples: Texture | None = None
    name: str = ""
    instance: int = 0

    @property
    def cutout(self) -> bool:
        """Whether the texture cuts holes into the part."""
        return self.texture is not None and self.texture.shape[2] == 4


def plain(part: Part) -> Part:
    """The part in one colour, the mean light of its texture; one with holes stays as it is."""
    if part.texture is None or part.cutout:
        return part
    mean = np.sqrt(np.square(part.texture.astype(np.float64)).mean(axis=(0, 1)))
    return replace(part, texture=np.rint(mean).astype(np.uint8)[None, None])


@dataclass(frozen=True, eq=False)
class Mover:
    """A part that moves: `world_from_part` gives its pose at a time in seconds."""

    part: Part
    world_from_part: Callable[[float], Pose]


@dataclass(frozen=True, kw_only=True)
class Roadway:
    """The road that a structure carries along x, through its middle: half its width between kerbs, its level.

    The structure ends half_length_m from its middle, at the level of the ground its front lies front_m from it.
    """

    half_width_m: float
    level_m: float
    half_length_m: float
    front_m: float


@dataclass(frozen=True, eq=False)
class BuiltStructure:
    """A structure as the tracker gets it, as it is drawn, and what the two differ by.

    structure is as designed; parts are as built; deviation says in words and numbers what was changed; road is the one
    that it carries, None for most.
    """

    structure: Structure
    parts: tuple[Part, ...]
    deviation: dict[str, float | str] = field(default_factory=dict)
    road: Roadway | None = None


@dataclass(frozen=True)
class Light:
    """Light of a scene, linear RGB: one far lamp (the sun) that throws shadows, light from above and from below.

    to_lamp is the direction towards the lamp; shadow_map throws its shadows when drawn (otherwise they are in the
    parts' tints); softness_m is the width of the shadows' edge; haze_per_m the share of light scattered in per metre.
    """

    to_lamp: tuple[float, float, float]
    lamp: tuple[float, float, float]
    above: tuple[float, float, float]
    below: tuple[float, float, float]
    shadow_map: bool = True
    softness_m: float = 0.01
    haze_per_m: float = 0.0
    haze_color: tuple[float, float, float] = (0.7, 0.8, 0.9)


@dataclass(frozen=True, eq=False)
class BuiltSite:
    """Ground that was shaped to a structure.

    parts are drawn beside the environment's; structure are those of the structure as they are drawn on it; height
    gives that of the ground at places (n, 2), is_free whether things may stand there; shades tells that parts are to be
    darkened by the ground too.
    """

    parts: tuple[Part, ...]
    structure: tuple[Part, ...]
    height: Callable[[Array], Array]
    is_free: Callable[[Array], NDArray[np.bool_]]
    shades: bool = False


@dataclass(frozen=True, eq=False)
class BuiltEnvironment:
    """Ground, walls and light around a structure; sky is a panorama (h, 2h, 3) or None indoors.

    The panorama is coded as the square root of light. Its columns run from azimuth -180 to 180 degrees (world x is
    0), its rows from the zenith down. Without textures each part of the structure shows the
    mean colour of its own, evenly lit. site shapes the ground to the structure, None for ground that is level.
    """

    parts: tuple[Part, ...]
    light: Light
    sky: Texture | None = None
    textures: bool = True
    site: Callable[[BuiltStructure, np.random.Generator], BuiltSite] | None = None


@dataclass(frozen=True, eq=False)
class BuiltClutter:
    """Still and moving things that are not the structure."""

    parts: tuple[Part, ...] = ()
    movers: tuple[Mover, ...] = ()
