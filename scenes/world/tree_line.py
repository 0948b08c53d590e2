"""Distant trees and hills all around: painted on textures that do not repeat, lit from the side of the sun."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Color
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories.pose import Array

BELT_PX, HILLS_PX = (256, 8192), (256, 4096)
"""Sizes of the textures. A column of the belt is 0.14 m wide, where a camera of 640 px and 78.7 degrees has 0.46 m."""
PER_M = np.array([BELT_PX[1] / (2 * np.pi * 180.0), BELT_PX[0] / 16.0])
"""Columns and rows of the belt per metre: it is 180 m away and 16 m high."""
ROWS, TREES = 3, 330
"""Rows of trees one behind the other, and trees in each: crowns of 5 m, which overlap, around a circle of 1130 m."""
BLOBS = 30
"""Clusters of leaves that are drawn of a crown."""
GROVE_PX = 700
"""Size of groves of one kind, and of stretches of higher and lower trees, px of the belt: 100 m."""
REPEATS, RAGGED_M = 8, 0.14
"""Times that the grain and the raggedness of crowns repeat around the belt, and the latter's standard deviation, m."""
HEDGE_M = 1.5
"""Height of the dark undergrowth above the lower side of the belt, which is 1 m below the ground."""
CONIFERS = 0.35
"""Share of conifers, by eye."""
LEAFY: tuple[Color, ...] = ((84.0, 102.0, 56.0), (98.0, 112.0, 60.0), (74.0, 92.0, 54.0), (108.0, 114.0, 66.0))
NEEDLED: tuple[Color, ...] = ((52.0, 72.0, 52.0), (60.0, 78.0, 54.0))
HILL: Color = (110.0, 126.0, 112.0)
"""sRGB colours (0..255) of crowns and of wooded hills."""
TILT = 1.0
"""Upward share of the normals of distant crowns beside that towards the middle, from where they are seen: by eye."""
SIDE = 0.38
"""Relative brightness that the side of a crown towards the sun has more than its middle, by eye."""


@dataclass(frozen=True)
class Crown:
    """A crown in the belt: its middle along the belt, half width and height, m, and the sun's share from the left."""

    middle: float
    half: float
    high: float
    from_left: float


@dataclass(frozen=True)
class Dab:
    """An ellipse in the belt: its middle along the belt and its height, half its width and half its height, m."""

    along: float
    up: float
    half: float
    half_high: float


def varied(hills: Part, belt: Part, to_sun: Array, rng: np.random.Generator) -> tuple[Part, ...]:
    """Plain hills and the belt of trees before them with textures all around; to_sun (3,) points to the sun."""
    for_hills, for_belt = rng.spawn(2)
    bearing = float(np.arctan2(to_sun[1], to_sun[0]))
    return _around(hills, hill_line(for_hills)), _around(belt, tree_line(bearing, for_belt))


def _around(band: Part, texture: Texture) -> Part:
    """A band with a texture that goes around it once, and with normals towards its middle."""
    corners = len(band.vertices) // 2
    assert band.uv is not None
    middle = band.vertices[: corners - 1, :2].mean(axis=0)
    inwards = middle - band.vertices[:, :2]
    inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
    normals = np.column_stack([inwards, np.full(2 * corners, TILT)])
    return replace(
        band,
        uv=np.column_stack([np.tile(np.arange(corners) / (corners - 1), 2), band.uv[:, 1]]),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        texture=texture,
        keeps_cover=True,
    )


def hill_line(rng: np.random.Generator) -> Texture:
    """RGBA texture (h, w) of wooded hills, its columns by azimuth from 0 on."""
    h, w = HILLS_PX
    outline = 0.56 + 0.15 * noise.fractal((1, w), 700, rng, octaves=9, gain=0.66)[0]
    up = 1 - np.arange(h, dtype=np.float32)[:, None] / h
    slopes = noise.fractal((h, w), 160, rng, octaves=6, gain=0.62)
    image = noise.paint(HILL, np.asarray((1 + 0.16 * slopes) * (0.72 + 0.32 * up / outline[None]), dtype=np.float32))
    return np.dstack([noise.finish(image), np.where(up < outline[None], 255, 0).astype(np.uint8)])


def tree_line(sun_bearing: float, rng: np.random.Generator) -> Texture:
    """RGBA texture (h, w) of trees, its columns by azimuth from 0 on; the sun is at a bearing, rad."""
    h, w = BELT_PX
    image = np.zeros((h, w, 4), dtype=np.uint8)
    image[..., :3] = np.array(LEAFY[0], dtype=np.uint8)
    low = h - round(HEDGE_M * float(PER_M[1]))
    image[low:] = [*(0.5 * np.array(LEAFY[0])).astype(np.uint8), 255]
    kinds, heights = (noise.tiling((1, w), GROVE_PX * size, rng)[0] for size in (1.0, 0.6))
    least = float(np.quantile(kinds, 1 - CONIFERS))
    around = w / float(PER_M[0])
    for row in range(ROWS):
        places = (np.arange(TREES) + rng.uniform(-0.5, 0.5, TREES)) * around / TREES
        for place in places.tolist():
            column = int(place * PER_M[0]) % w
            needled = kinds[column] + 0.5 * float(rng.standard_normal()) > least
            high = (9.0 + 2.2 * float(heights[column]) - 1.6 * row) * float(rng.uniform(0.7, 1.2))
            high = float(np.clip(high + (1.5 if needled else 0.0), 2.0, 15.0))
            half = high * float(rng.uniform(0.17, 0.24) if needled else rng.uniform(0.24, 0.40))
            from_left = float(np.sin(sun_bearing - place / around * 2 * np.pi))  # bearings grow to the left
            crown = Crown(place, half, high, from_left)
            (_conifer if needled else _broadleaf)(image, crown, 0.74 + 0.13 * row, rng)
    ragged = _ragged(image, rng)
    grain = 1 + 0.10 * np.tile(noise.tiling((h, w // REPEATS), 2.5, rng), REPEATS)
    ragged[..., :3] = noise.finish(ragged[..., :3].astype(np.float32) * grain[..., None])
    return ragged


def _ragged(image: Texture, rng: np.random.Generator) -> Texture:
    """The image with outlines of twigs in place of smooth ones: each pixel is taken from a place nearby."""
    h, w = image.shape[:2]
    aside, along = (np.tile(noise.fractal((h, w // REPEATS), 9, rng, octaves=3, gain=0.8), REPEATS) for _ in range(2))
    rows, columns = np.mgrid[:h, :w].astype(np.float32)
    u, v = columns + np.float32(RAGGED_M * PER_M[0]) * aside, rows + np.float32(RAGGED_M * PER_M[1]) * along
    taken = cv2.remap(image, u, np.clip(v, 0, h - 1), cv2.INTER_NEAREST, borderMode=cv2.BORDER_WRAP)
    return np.asarray(taken, dtype=np.uint8)


def _broadleaf(image: Texture, crown: Crown, dim: float, rng: np.random.Generator) -> None:
    """Clusters of leaves, from the inside of a crown outwards, lit from above and from the sun's side."""
    color = np.array(LEAFY[int(rng.integers(len(LEAFY)))]) * dim * float(rng.uniform(0.85, 1.12))
    angle, far = rng.uniform(0, 2 * np.pi, BLOBS), np.sqrt(np.linspace(0.0, 1.0, BLOBS))
    aside, up = far * np.cos(angle), far * np.sin(angle)
    _dab(image, Dab(crown.middle, 0.56 * crown.high, 0.88 * crown.half, 0.38 * crown.high), 0.74 * color)
    size = crown.half * rng.uniform(0.20, 0.36, BLOBS) * (1.25 - 0.5 * far)
    for k in range(BLOBS):
        tone = 0.86 + 0.20 * up[k] - 0.5 * SIDE * crown.from_left * aside[k] + float(rng.normal(0, 0.07))
        place = crown.middle + 0.76 * crown.half * aside[k]
        _dab(image, Dab(place, crown.high * (0.55 + 0.35 * up[k]), size[k], 0.8 * size[k]), color * tone)
    _dab(image, Dab(crown.middle, 0.08 * crown.high, 0.9 * crown.half, 0.2 * crown.high), color * 0.55)


def _conifer(image: Texture, crown: Crown, dim: float, rng: np.random.Generator) -> None:
    """Whorls of twigs that narrow to the top, the side towards the sun lighter."""
    color = np.array(NEEDLED[int(rng.integers(len(NEEDLED)))]) * dim * float(rng.uniform(0.85, 1.12))
    for share in np.linspace(0.02, 0.97, 22).tolist():
        wide = crown.half * (1.02 - share) * float(rng.uniform(0.8, 1.1))
        for side in (-1, 1):
            tone = 0.84 + 0.14 * share - 0.5 * SIDE * crown.from_left * side + float(rng.normal(0, 0.05))
            place = crown.middle + 0.45 * side * wide
            _dab(image, Dab(place, crown.high * share, 0.6 * wide + 0.1, 0.045 * crown.high), color * tone)


def _dab(image: Texture, dab: Dab, color: Array) -> None:
    """Fill an ellipse, and its copy beyond the image's left or right end."""
    h, w = image.shape[:2]
    drawn = (*(int(c) for c in color.clip(0, 255)), 255)
    column, row = dab.along * PER_M[0], h - 1 - dab.up * PER_M[1]
    axes = (max(round(dab.half * PER_M[0]), 1), max(round(dab.half_high * PER_M[1]), 1))
    for shift in (-w, 0, w):
        if -axes[0] <= column + shift < w + axes[0]:
            cv2.ellipse(image, (round(column + shift), round(row)), axes, 0, 0, 360, drawn, -1, cv2.LINE_8)
