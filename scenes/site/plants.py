"""Unmown vegetation: tufts of grass and herbs along walls and piers, reeds along water."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

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
ASIDE_M = 0.18
"""Mean distance of tufts from a wall, metres, by eye."""
CLUMP, CLUMP_M, ALONE = 7, 0.22, 0.2
"""Mean number of tufts in a clump, standard deviation of their distance from its middle along the wall, metres, and
share of tufts that stand alone: by eye."""
VIGOUR, UNLIKE, LOWER_PER_M = 1.2, 0.13, 0.9
"""Exponent by which low clumps are more frequent than high ones, standard deviation of tufts within a clump, and by how
much tufts are lower for each metre away from the wall, of the range of log heights: by eye."""
TRODDEN_M = (0.45, 2.5)
"""Widths beside a door, and length of the way to it, on which nothing grows, metres: by eye."""
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


@dataclass(frozen=True, eq=False)
class Look:
    """What plants look like: a texture with so many drawings side by side, each `wide` times as wide as high."""

    texture: Texture
    drawings: int
    wide: float


def tufts(rng: np.random.Generator) -> Look:
    """Grass that is dense, tall and dry, and low."""
    drawn = [
        blades(rng, 70, (98.0, 118.0, 52.0), 0.16),
        blades(rng, 30, (124.0, 124.0, 66.0), 0.22),
        blades(rng, 50, (84.0, 110.0, 50.0), 0.26),
    ]
    return Look(np.concatenate(drawn, axis=1), len(drawn), 0.9)


def reeds(rng: np.random.Generator) -> Look:
    """Reeds."""
    return Look(blades(rng, 26, (118.0, 126.0, 66.0), 0.07), 1, 0.55)


def at_feet(terrain: Terrain, doors: Array, density: float, rng: np.random.Generator) -> Stand:
    """Tufts along the footprints of the structure, on dry ground outside the carriageway and the ways to doors.

    doors (n, 2, 2): the ends of each on the ground, counter-clockwise around the structure, metres. Tufts stand in
    clumps and alone, lower the farther from the wall, of heights in TUFT_M; density 1 is TUFTS_PER_M.
    """
    places, shares = [np.zeros((0, 2))], [np.zeros(0)]
    for low, high in terrain.feet:
        around = 2 * float((high - low).sum())
        count = round(around * TUFTS_PER_M * density)
        middles = rng.uniform(0, around, max(1, round(count / CLUMP)))
        clump = rng.integers(len(middles), size=count)
        along = middles[clump] + rng.normal(0, CLUMP_M, count)
        alone = rng.random(count) < ALONE
        along[alone] = rng.uniform(0, around, int(alone.sum()))
        aside = rng.exponential(ASIDE_M, count)
        vigour = rng.random(len(middles)) ** VIGOUR
        places.append(_beside(low, high, along % around, aside))
        shares.append(vigour[clump] + rng.normal(0, UNLIKE, count) - LOWER_PER_M * aside)
    at = np.concatenate(places)
    lowest, highest = np.log(TUFT_M)
    heights = np.exp(lowest + (highest - lowest) * np.concatenate(shares).clip(0, 1))
    low_m, high_m = terrain.feet[:, 0], terrain.feet[:, 1]
    within = (at[:, None] > low_m) & (at[:, None] < high_m)  # (n, feet, 2)
    inside = np.asarray((within[..., 0] & within[..., 1]).any(axis=1))
    dry = terrain.height(at) > -WATER_M / 2
    if terrain.course is not None and terrain.course.kind == "road":
        dry &= terrain.course.across(at) > terrain.course.half_m
    free = dry & ~inside & ~_before(doors, at)
    return Stand(at[free], heights[free])


def _beside(low: Array, high: Array, along: Array, aside: Array) -> Array:
    """Points (n, 2) aside of a rectangle from low to high (2,), at distances (n,) along its sides from low; metres."""
    w, h = high - low
    front, right, back = along < w, along < w + h, along < 2 * w + h
    x = np.select([front, right, back], [low[0] + along, high[0] + aside, high[0] - (along - w - h)], low[0] - aside)
    y = np.select([front, right, back], [low[1] - aside, low[1] + along - w, high[1] + aside], high[1])
    left = ~(front | right | back)
    y[left] -= along[left] - 2 * w - h
    return np.column_stack([x, y])


def _before(doors: Array, at: Array) -> NDArray[np.bool_]:
    """Mask (n,) of points (n, 2) before doors (k, 2, 2), see `at_feet`."""
    beside, ahead = TRODDEN_M
    before = np.zeros(len(at), dtype=bool)
    for start, end in doors:
        wide = float(np.linalg.norm(end - start))
        along = (end - start) / wide
        outward = np.array([along[1], -along[0]])
        u, v = (at - start) @ along, (at - start) @ outward
        before |= (u > -beside) & (u < wide + beside) & (v > -beside) & (v < ahead)
    return before


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


def cards(stand: Stand, terrain: Terrain, look: Look, rng: np.random.Generator) -> Part:
    """Two crossed upright cards for each plant, one of the look's drawings on each, mirrored or not.

    Each card has a triangle pair per side, all with upward normals, so that both sides are lit from above.
    """
    n = len(stand.places)
    z = terrain.height(stand.places) - 0.02
    turn = rng.uniform(0, np.pi, n)
    lean = rng.normal(0, 0.12, (n, 2)) * stand.heights_m[:, None]
    corners = np.zeros((n, 2, 4, 3))
    for k in range(2):
        across = np.column_stack([np.cos(turn + k * np.pi / 2), np.sin(turn + k * np.pi / 2)])
        half = 0.5 * look.wide * stand.heights_m[:, None] * across
        for c, (side, up) in enumerate(((-1, 0), (1, 0), (1, 1), (-1, 1))):
            corners[:, k, c, :2] = stand.places + side * half + up * lean
            corners[:, k, c, 2] = z + up * stand.heights_m
    first = 4 * np.arange(2 * n)[:, None]
    tone = np.repeat(rng.uniform(0.7, 1.15, n), 8)
    shade = tone * np.tile([0.6, 0.6, 1.3, 1.3], 2 * n)  # darker at the roots
    sides = np.tile([[0.02, 0.98, 0.98, 0.02]], (2 * n, 1))
    mirrored = rng.random(2 * n) < 0.5
    sides[mirrored] = 1 - sides[mirrored]
    u = (rng.integers(look.drawings, size=2 * n)[:, None] + sides) / look.drawings
    return Part(
        vertices=corners.reshape(-1, 3),
        triangles=np.concatenate([first + np.array(corner) for corner in BOTH_SIDES]),
        normals=np.tile([0.0, 0.0, 1.0], (8 * n, 1)),
        uv=np.column_stack([u.reshape(-1), np.tile([0.02, 0.02, 0.98, 0.98], 2 * n)]),
        texture=look.texture,
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
