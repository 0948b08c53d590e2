"""An outdoor environment: sun, sky with clouds, ground, and distant trees and hills."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.materials.patches import Patches, patches
from uavbench.scenes.materials.procedural_texture import Image, Octave
from uavbench.scenes.renderables import (
    BuiltEnvironment,
    BuiltSite,
    BuiltStructure,
    Confines,
    Light,
    Part,
    Streams,
    Texture,
)
from uavbench.scenes.site.site import Site
from uavbench.scenes.world.cloud_deck import DENSEST_EDGE, Clouds, clouds
from uavbench.scenes.world.tree_line import varied
from uavbench.trajectories.pose import Angle, Array

SKY_PX, TILE_PX = (1024, 2048), 1024
RIM_M = 180.0
ZENITH, HORIZON = (88.0, 142.0, 212.0), (202.0, 220.0, 236.0)
CLOUD, CLOUD_SHADE, GROUND = (246.0, 246.0, 244.0), (164.0, 170.0, 180.0), (132.0, 136.0, 112.0)
"""sRGB colours (0..255) of the sky, the clouds, and the ground below the horizon."""
LOW_SUN_RAD = np.radians(15.0)
LOW_ZENITH, LOW_HORIZON, LOW_CLOUD = (70.0, 98.0, 152.0), (255.0, 196.0, 130.0), (255.0, 214.0, 178.0)
"""Elevation of the sun below which the sky's colours turn to these, fully at the horizon and on its side: by eye."""
CLOSING_FROM, CLOSING, CLOUD_HORIZON = 0.8, 12.5, (198.0, 203.0, 209.0)
"""Cloudiness from which the gaps between clouds close, and by how many standard deviations of their field for a unit
of it, and the colour of the horizon once there are none: by eye."""
WOODED = tuple(
    Octave(0.7**k, high, wide) for k, (high, wide) in enumerate(((48, 240), (32, 120), (24, 60), (18, 30), (15, 15)))
)
"""Woods on distant hills: larger patches are foreshortened, since the slopes are seen at a slant; by eye."""
CROWNS = tuple(Octave(0.7**k, 28 / 2**k, 28 / 2**k) for k in range(5))
"""Crowns in the belt of trees before them, by eye."""


@dataclass(frozen=True)
class Outdoor:
    """An open field around the structure under a sky.

    sun_elevation_deg and sun_azimuth_deg give the direction of the sun (azimuth from x towards y, random when None);
    cloudiness ranges from 0, a clear sky, to 1, an overcast one without direct sunlight and sharp shadows. haze_per_km
    is the extinction coefficient. sharp_textures takes finer mipmaps; grain is the standard deviation of the log albedo
    of all surfaces in each octave, ground_patches that of patches of the ground. varied_horizon gives clouds sides and
    flat bases, and trees and hills that do not repeat and are lit from the sun's side. site shapes the ground to the
    structure; by default it is level and empty.
    """

    ground: Literal["grass", "meadow", "gravel", "asphalt", "concrete"] = "grass"
    sun_elevation_deg: Annotated[float, Interval(gt=3, le=90)] = 42.0
    sun_azimuth_deg: Angle | None = None
    cloudiness: Annotated[float, Interval(ge=0, le=1)] = 0.35
    haze_per_km: Annotated[float, Ge(0)] = 1.5
    brightness: Annotated[float, Gt(0), Interval(le=10)] = 1.0
    sharp_textures: bool = False
    grain: Annotated[float, Interval(ge=0, le=0.3)] = 0.0
    ground_patches: Annotated[float, Interval(ge=0, le=0.6)] = 0.0
    varied_horizon: bool = False
    site: Site = field(default_factory=Site)

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltEnvironment:
        """Ground, distant trees and hills, light and sky panorama for a structure of bounds (2, 3) in metres."""
        azimuth = np.radians(rng.uniform(0, 360) if self.sun_azimuth_deg is None else self.sun_azimuth_deg)
        elevation = np.radians(self.sun_elevation_deg)
        to_sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        open_sky = (1 - self.cloudiness) ** 0.7
        warm = np.array([1.0, 0.62 + 0.36 * np.sin(elevation), 0.35 + 0.57 * np.sin(elevation)])
        b = self.brightness
        above = np.array([0.34, 0.40, 0.50]) * (0.75 + 0.5 * self.cloudiness)
        light = Light(
            to_lamp=_triple(to_sun),
            lamp=_triple(b * 0.95 * open_sky * warm),
            above=_triple(b * above),
            below=_triple(b * np.array([0.17, 0.16, 0.12])),
            softness_m=0.02 + 0.5 * self.cloudiness**2,
            haze_per_m=self.haze_per_km / 1000,
            haze_color=_triple(b * np.array([0.62, 0.70, 0.80])),
        )
        sky = noise.finish(_sky(to_sun, self.cloudiness, rng, heaped=self.varied_horizon) * np.sqrt(b))
        look = materials.PAINTS[self.ground](rng)
        level = _level_ground(look, bounds, rng)  # drawn with a site, too: the hills are those of the field without it
        rim = _rim(bounds, rng)
        if self.varied_horizon:
            hills, belt = rim
            rim = varied(hills, belt, to_sun, rng)
        drawn = patches(self.ground_patches, look.soaks, rng) if self.ground_patches > 0 else None
        built = partial(BuiltEnvironment, light=light, sky=sky, sharp=self.sharp_textures, grain=self.grain)
        if self.site == Site():
            return built(_patched((level, *rim), look, drawn))
        return built(rim, site=partial(self._site, look, drawn))

    def confines(self, built: BuiltStructure, rng: np.random.Generator, streams: Streams) -> Confines:
        """The site's ground and neighbours, those of `build`."""
        return Confines() if self.site == Site() else Confines(self.site.layout(built, streams))

    def _site(self, look: Material, drawn: Patches | None, structure: BuiltStructure, streams: Streams) -> BuiltSite:
        site = self.site.build(look, structure, streams)
        return replace(site, parts=_patched(site.parts, look, drawn))


def _patched(parts: tuple[Part, ...], look: Material, drawn: Patches | None) -> tuple[Part, ...]:
    """The parts, those of the ground with its patches."""
    if drawn is None:
        return parts
    return tuple(drawn.on(part) if part.texture is look.texture else part for part in parts)


def _level_ground(look: Material, bounds: Array, rng: np.random.Generator) -> Part:
    """Level ground around the structure, in rings."""
    centre = bounds.mean(axis=0)[:2]
    extent = float(np.linalg.norm((bounds[1] - bounds[0])[:2]))
    rings = np.concatenate([np.linspace(0, 1.2 * extent, 10), np.geomspace(1.6 * extent, 6 * RIM_M, 9)])
    spokes = 28
    angle = np.arange(spokes) * 2 * np.pi / spokes
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    flat = np.concatenate([[centre], *(centre + r * around for r in rings[1:])])
    i = np.arange(spokes)
    j = (i + 1) % spokes
    triangles = [np.column_stack([np.zeros(spokes, dtype=np.int64), 1 + i, 1 + j])]
    for k in range(len(rings) - 2):
        a, b = 1 + k * spokes, 1 + (k + 1) * spokes
        triangles += [np.column_stack([a + i, b + i, b + j]), np.column_stack([a + i, b + j, a + j])]
    tone = 1 + 0.10 * np.clip(rng.standard_normal(len(flat)), -2, 2)
    tint = np.column_stack([tone * (1 + 0.03 * rng.standard_normal(len(flat))), tone, tone, np.ones(len(flat))])
    return Part(
        vertices=np.column_stack([flat, np.zeros(len(flat))]),
        triangles=np.concatenate(triangles),
        normals=np.tile([0.0, 0.0, 1.0], (len(flat), 1)),
        uv=flat / np.array(look.tile_m),
        texture=look.texture,
        tint=tint,
        roughness=1.0,
        casts_shadow=False,
    )


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _sky(to_sun: Array, cloudiness: float, rng: np.random.Generator, heaped: bool = False) -> Image:
    """Equirectangular panorama: blue that pales towards the horizon and the sun, and a plane of clouds above."""
    h, w = SKY_PX
    image = np.full((h, w, 3), GROUND, dtype=np.float32)
    rows = h // 2 + 8  # further down only ground is visible
    elevation = ((0.5 - (np.arange(rows, dtype=np.float32)[:, None] + 0.5) / h) * np.pi).astype(np.float32)
    azimuth = (((np.arange(w, dtype=np.float32) + 0.5) / w * 2 - 1) * np.pi).astype(np.float32)
    up, level = np.sin(elevation), np.cos(elevation)
    x, y = level * np.cos(azimuth), level * np.sin(azimuth)
    sun = to_sun.astype(np.float32)
    near_sun = np.clip(x * sun[0] + y * sun[1] + up * sun[2], 0, 1)
    glow, disc = np.square(np.square(np.square(near_sun))) ** 3, np.exp(1500 * (near_sun - 1))
    pale = np.exp(-5 * np.clip(up, 0, 1))
    low = max(0.0, 1 - float(np.arcsin(to_sun[2])) / LOW_SUN_RAD)
    toward = low * np.square(0.5 + 0.5 * np.cos(azimuth - np.float32(np.arctan2(to_sun[1], to_sun[0]))))[None, :, None]
    zenith, horizon = _turned(ZENITH, LOW_ZENITH, 0.7 * low), _turned(HORIZON, LOW_HORIZON, 0.3 * low + 0.7 * toward)
    blue = noise.paint((60.0, 52.0, 36.0), glow) + noise.paint((200.0, 200.0, 200.0), disc)
    closed = max(0.0, cloudiness - CLOSING_FROM)
    horizon = _turned(horizon, CLOUD_HORIZON, closed / (1 - CLOSING_FROM))
    blue += (zenith * (1 - pale[..., None]) + horizon * pale[..., None]).astype(np.float32)
    field = noise.fractal((TILE_PX, TILE_PX), 300, rng, octaves=8, gain=0.58)
    edge = np.float32(1.5 - 2.9 * cloudiness - CLOSING * closed)
    if heaped:
        seen = clouds(field, float(edge), elevation[:, 0].astype(np.float64), azimuth.astype(np.float64))
    else:
        seen = _plain_clouds(field, edge, (x, y, up))
    lit = np.broadcast_to(_turned(CLOUD, LOW_CLOUD, 0.5 * low + 0.5 * toward).astype(np.float32), (rows, w, 3))
    white = noise.blend(lit, CLOUD_SHADE, seen.shade)
    sky = noise.blend(blue, white, 0.92 * seen.opacity)
    image[:rows] = noise.blend(sky, GROUND, np.clip(-60 * up, 0, 1) * np.ones_like(seen.opacity))
    return image


def _turned(color: Any, other: Any, part: Any) -> NDArray[np.float64]:
    """A color, by a part (0..1) turned to another one."""
    return np.asarray(np.array(color) + part * (np.array(other) - np.array(color)))


def _plain_clouds(field: Image, edge: np.float32, way: tuple[Image, Image, Image]) -> Clouds:
    """A plane of clouds where a field exceeds an edge; way is (x, y, up), (h, w) each."""
    x, y, up = way
    height = np.clip(up, 0.035, 1)
    lit = noise.blurred_tile(field, 10)
    u, v = (np.mod(along / height * 130 + 4000, TILE_PX).astype(np.float32) for along in (x, y))
    cover, thick = (cv2.remap(f, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) for f in (field, lit))
    mask = np.clip((cover - edge) / np.float32(0.9), 0, 1)
    mask = mask * mask * (3 - 2 * mask) * np.clip((up - 0.01) / 0.10, 0, 1)
    return Clouds(mask, np.clip((thick - max(edge, DENSEST_EDGE)) / np.float32(2.5), 0, 1))


def _rim(bounds: Array, rng: np.random.Generator) -> tuple[Part, ...]:
    """Distant hills and a belt of trees: two alpha-tested cylindrical bands with an irregular skyline."""
    centre = bounds.mean(axis=0)[:2]
    out = []
    for distance, height, color, rough, tones in (
        (RIM_M * 2.2, 42.0, (112.0, 128.0, 118.0), 120.0, WOODED),
        (RIM_M, 15.0, (70.0, 86.0, 52.0), 14.0, CROWNS),
    ):
        texture = _band(color, rough, tones, rng)
        sides = 40
        angle = np.arange(sides + 1) * 2 * np.pi / sides
        around = np.column_stack([np.cos(angle), np.sin(angle)]) * distance + centre
        low = np.column_stack([around, np.full(sides + 1, -1.0)])
        high = np.column_stack([around, np.full(sides + 1, height)])
        i = np.arange(sides)
        corners = sides + 1
        triangles = [np.column_stack([i, corners + i, corners + i + 1]), np.column_stack([i, corners + i + 1, i + 1])]
        u = np.arange(corners) / 4.0
        out.append(
            Part(
                vertices=np.concatenate([low, high]),
                triangles=np.concatenate(triangles),
                normals=np.tile([0.0, 0.0, 1.0], (2 * corners, 1)),
                uv=np.concatenate(
                    [np.column_stack([u, np.full(corners, 0.01)]), np.column_stack([u, np.full(corners, 0.99)])]
                ),
                texture=texture,
                roughness=1.0,
                two_sided=True,
                casts_shadow=False,
            )
        )
    return tuple(out)


def _band(
    color: tuple[float, float, float], rough_px: float, tones: tuple[Octave, ...], rng: np.random.Generator
) -> Texture:
    """RGBA texture (h, w) of hills or trees of a colour, with a skyline that is rough_px rough and tones of octaves."""
    h, w = 256, 2048
    outline = 0.58 + 0.13 * noise.fractal((1, w), rough_px * 12, rng, octaves=7, gain=0.72)[0]
    y = 1 - np.arange(h, dtype=np.float32)[:, None] / h
    crowns = noise.layered((h, w), tones, rng)
    image = noise.paint(color, (1 + 0.22 * crowns) * (0.55 + 0.6 * y / outline[None]))
    alpha = np.where(y < outline[None], 255, 0).astype(np.uint8)
    return np.dstack([noise.finish(image), alpha])
