"""Unmown vegetation: tufts of grass and herbs along walls and piers, reeds along water."""

from dataclasses import dataclass

import cv2
import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Part, Texture
from uavbench.scenes.site.terrain import BANK_SLOPE, WATER_M, Terrain
from uavbench.trajectories.pose import Array

INSTANCE = 2
"""Value of plants in the instance mask, shared with trees."""
TUFT_M = (0.12, 0.55)
"""Heights of grasses and ruderal herbs along walls, m (Ellenberg & Leuschner 2010, trampled and ruderal stands)."""
REED_M = (0.8, 2.0)
"""Heights of reeds at the water's edge, m (Haslam 1972, Phragmites communis: 0.5 to 3 m)."""
ASIDE_M = 0.30
"""Scale of the distance of tufts from a wall, metres; its mean is a quarter of this."""
TUFTS_PER_M, REEDS_PER_M = 6.0, 3.0
"""Plants per metre of wall or bank at density 1."""
REEDS_ALONG_M = 45.0
"""Length of the bank with reeds on either side of the structure, metres."""


BOTH_SIDES = ((0, 1, 2), (0, 2, 3), (0, 2, 1), (0, 3, 2))
"""Triangles of a card, front and back."""


@dataclass(frozen=True, eq=False)
class Stand:
    """Positions (n, 2) of plants in the world, and their heights (n,), metres."""

    places: Array
    heights_m: Array


def at_feet(terrain: Terrain, density: float, rng: np.random.Generator) -> Stand:
    """Tufts along the footprints of the structure, on dry ground outside the carriageway.

    Heights are log-normal, clipped to TUFT_M; density 1 is TUFTS_PER_M.
    """
    places = []
    for (x0, y0), (x1, y1) in terrain.feet:
        around = 2 * (x1 - x0 + y1 - y0)
        for _ in range(round(around * TUFTS_PER_M * density)):
            t, aside = rng.uniform(0, around), rng.exponential(ASIDE_M / 4)
            w, h = x1 - x0, y1 - y0
            if t < w:
                places.append((x0 + t, y0 - aside))
            elif t < w + h:
                places.append((x1 + aside, y0 + t - w))
            elif t < 2 * w + h:
                places.append((x1 - (t - w - h), y1 + aside))
            else:
                places.append((x0 - aside, y1 - (t - 2 * w - h)))
    at = np.array(places).reshape(-1, 2)
    low, high = np.log(TUFT_M)
    heights = np.exp(np.clip(rng.normal((low + high) / 2, (high - low) / 4, len(at)), low, high))
    low_m, high_m = terrain.feet[:, 0], terrain.feet[:, 1]
    within = (at[:, None] > low_m) & (at[:, None] < high_m)  # (n, feet, 2)
    inside = np.asarray((within[..., 0] & within[..., 1]).any(axis=1))
    dry = terrain.height(at) > -WATER_M / 2
    if terrain.course is not None and terrain.course.kind == "road":
        dry &= terrain.course.across(at) > terrain.course.half_m
    return Stand(at[dry & ~inside], heights[dry & ~inside])


def at_water(terrain: Terrain, density: float, rng: np.random.Generator) -> Stand:
    """Clumps of reeds along both banks of a river, except underneath the structure; none without a river."""
    course = terrain.course
    if course is None or course.kind != "river":
        return Stand(np.zeros((0, 2)), np.zeros(0))
    low, high = terrain.bounds[0, 1] - REEDS_ALONG_M, terrain.bounds[1, 1] + REEDS_ALONG_M
    count = round(2 * (high - low) * REEDS_PER_M * density)
    clumps = rng.uniform(low, high, max(1, count // 12))
    y = rng.choice(clumps, count) + rng.normal(0, 0.8, count)
    side = rng.choice([-1.0, 1.0], count)
    edge = course.half_m - BANK_SLOPE * WATER_M
    x = course.centre_m + course.aside(y) + side * (edge + rng.normal(0.15, 0.25, count))
    at = np.column_stack([x, y])
    beneath = (at[:, 1] > terrain.bounds[0, 1]) & (at[:, 1] < terrain.bounds[1, 1])  # too dark to grow
    return Stand(at[~beneath], rng.uniform(*REED_M, count)[~beneath])


def cards(stand: Stand, terrain: Terrain, texture: Texture, wide: float, rng: np.random.Generator) -> Part:
    """Two crossed upright cards for each plant, `wide` times as wide as high.

    Each card has a triangle pair per side, all with upward normals, so that both sides are lit from above.
    """
    n = len(stand.places)
    z = terrain.height(stand.places) - 0.02
    turn = rng.uniform(0, np.pi, n)
    lean = rng.normal(0, 0.12, (n, 2)) * stand.heights_m[:, None]
    corners = np.zeros((n, 2, 4, 3))
    for k in range(2):
        across = np.column_stack([np.cos(turn + k * np.pi / 2), np.sin(turn + k * np.pi / 2)])
        half = 0.5 * wide * stand.heights_m[:, None] * across
        for c, (side, up) in enumerate(((-1, 0), (1, 0), (1, 1), (-1, 1))):
            corners[:, k, c, :2] = stand.places + side * half + up * lean
            corners[:, k, c, 2] = z + up * stand.heights_m
    first = 4 * np.arange(2 * n)[:, None]
    tone = np.repeat(rng.uniform(0.7, 1.15, n), 8)
    shade = tone * np.tile([0.6, 0.6, 1.3, 1.3], 2 * n)  # darker at the roots
    return Part(
        vertices=corners.reshape(-1, 3),
        triangles=np.concatenate([first + np.array(corner) for corner in BOTH_SIDES]),
        normals=np.tile([0.0, 0.0, 1.0], (8 * n, 1)),
        uv=np.tile([[0.02, 0.02], [0.98, 0.02], [0.98, 0.98], [0.02, 0.98]], (2 * n, 1)),
        texture=texture,
        tint=np.column_stack([shade, shade, shade, np.ones(8 * n)]),
        roughness=1.0,
        casts_shadow=False,
        instance=INSTANCE,
        keeps_cover=True,
    )


def blades(rng: np.random.Generator, count: int, color: tuple[float, float, float], bow: float) -> Texture:
    """RGBA texture of blades that rise from the middle of the lower edge and bend sideways; color in sRGB (0..255)."""
    n = 256
    image = np.zeros((n, n, 4), dtype=np.uint8)
    image[..., :3] = np.array(color, dtype=np.uint8)
    for _ in range(count):
        foot, tall = rng.normal(n / 2, n / 7), rng.uniform(0.45, 0.97) * n
        aside = rng.normal(0, bow) * n
        t = np.linspace(0, 1, 16)
        x, y = foot + aside * t**2, n - 1 - tall * t
        wide = rng.uniform(2.0, 4.5) * (1 - t) + 0.6
        outline = np.concatenate([np.column_stack([x - wide, y]), np.column_stack([x + wide, y])[::-1]])
        tone = np.array(color) * rng.uniform(0.65, 1.25) + rng.normal(0, 6, 3)
        drawn = (*(int(c) for c in tone.clip(0, 255)), 255)
        cv2.fillPoly(image, [np.rint(outline).astype(np.int32)], drawn)
    grain = 1 + 0.08 * noise.tiling((n, n), 3, rng)
    image[..., :3] = noise.finish(image[..., :3].astype(np.float32) * grain[..., None])
    return image
