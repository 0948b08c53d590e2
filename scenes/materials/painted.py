"""Procedural, tileable materials: concrete, brick, steel, asphalt, grass, glass, cloth.

Colours are sRGB (0..255); the textures are drawn from the random generator alone.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Texture
from uavbench.trajectories.pose import Array

Color = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Material:
    """A tileable texture that covers tile_m metres (along u, along v), and the roughness of the surface (0..1).

    No water stands on a surface that soaks it up.
    """

    texture: Texture
    tile_m: tuple[float, float]
    roughness: float = 0.85
    soaks: bool = False


UNPAINTED = Material(np.full((1, 1, 3), 128, dtype=np.uint8), (1.0, 1.0))
"""A material that takes no time, for where only the geometry counts."""


def concrete(rng: np.random.Generator, color: Color = (168.0, 164.0, 156.0), boards: bool = True) -> Material:
    """Fair-faced concrete, 4 m square: formwork joints and tie holes (if boards), pores, rain streaks, stains."""
    n = 1024
    px = n / 4.0
    shade = 1 + 0.045 * noise.fractal((n, n), 300, rng, octaves=7, gain=0.65)
    shade += 0.022 * noise.tiling((n, n), 1.6, rng)
    streaks = noise.tiling((n, n), (500, 7), rng) * np.clip(0.5 + noise.tiling((n, n), 240, rng), 0, 2)
    shade -= 0.035 * np.clip(streaks, 0, 3)
    image = noise.paint(color, shade)
    pores = np.clip(noise.tiling((n, n), 2.2, rng) - 2.5, 0, 1)
    image = noise.blend(image, (88, 84, 78), np.clip(1.5 * pores, 0, 1))
    stains = np.clip(noise.fractal((n, n), 200, rng, octaves=5) - 1.0, 0, 1.2)
    image = noise.blend(image, (120, 112, 98), 0.45 * np.clip(stains, 0, 1))
    if boards:
        joints = np.zeros((n, n), dtype=np.uint8)
        for k in range(2):
            at = k * n // 2
            joints[:, at : at + 2] = joints[at : at + 2] = 255
            for j in range(4):
                place = (round(at + 0.25 * n), round((j + 0.5) * n / 4))
                cv2.circle(joints, place, round(0.022 * px), 255, -1, cv2.LINE_AA)
        image = noise.blend(image, (92, 88, 82), 0.6 * noise.blurred(joints.astype(np.float32) / np.float32(255), 0.8))
    return Material(noise.finish(image), (4.0, 4.0), 0.9)


def brick(rng: np.random.Generator, color: Color = (150.0, 94.0, 76.0)) -> Material:
    """Bricks of 240 x 71 mm in running bond with 12 mm mortar joints: 24 courses of 12 bricks."""
    rows, columns, h, w = 24, 12, 1536, 2268
    course, length = h // rows, w // columns
    joint_v, joint_u = round(course * 12 / 83), round(length * 12 / 252)
    image = np.zeros((h, w, 3), dtype=np.float32)
    mortar = np.ones((h, w), dtype=np.float32)
    for row in range(rows):
        for column in range(columns):
            tone = np.array(color) * (1 + rng.normal(0, 0.09)) + rng.normal(0, 3, 3)
            if rng.random() < 0.08:
                tone *= 0.7
            left = column * length + (length // 2 if row % 2 else 0)
            cols = np.arange(left, left + length - joint_u) % w
            rows_px = slice(row * course, (row + 1) * course - joint_v)
            image[rows_px, cols] = tone
            mortar[rows_px, cols] = 0
    rough = 1 + 0.10 * noise.tiling((h, w), 3, rng) + 0.07 * noise.fractal((h, w), 30, rng, octaves=3)
    image = image * rough[..., None]
    sand = noise.paint((176, 168, 152), 1 + 0.08 * noise.tiling((h, w), 2, rng))
    soft = noise.blurred(mortar, 1.0)
    image = noise.blend(image, sand, soft)
    lower = np.roll(soft, 2, axis=0) - soft
    image *= (1 + 0.25 * np.clip(-lower, -1, 0))[..., None]
    image *= (1 + 0.06 * noise.fractal((h, w), 500, rng, octaves=3))[..., None]
    return Material(noise.finish(image), (columns * 0.252, rows * 0.083), 0.9)


def painted_steel(rng: np.random.Generator, color: Color = (92.0, 112.0, 104.0), rust: float = 1.0) -> Material:
    """Weathered paint on steel, 3 m square: faded patches, rust spots and streaks, two rows of rivets."""
    n = 1024
    shade = 1 + 0.05 * noise.fractal((n, n), 260, rng, octaves=6, gain=0.6) + 0.02 * noise.tiling((n, n), 2, rng)
    image = noise.paint(color, shade)
    faded = np.clip(noise.fractal((n, n), 330, rng, octaves=3), 0, 1)
    image = noise.blend(image, tuple(0.6 * np.array(color) + 80), 0.35 * faded)
    spots = noise.fractal((n, n), 60, rng, octaves=5, gain=0.75)
    bare = np.clip((spots - 2.3 + 0.5 * rust) * 2, 0, 1)
    runs = np.clip(noise.blurred(bare, 2), 0, 1)
    for _ in range(5):
        runs = np.maximum(runs, 0.93 * np.roll(runs, 9, axis=0))
    brown = noise.paint((126, 70, 40), 1 + 0.22 * noise.tiling((n, n), 4, rng))
    image = noise.blend(image, brown, 0.40 * np.clip(runs, 0, 1) * min(rust, 1.0))
    image = noise.blend(image, brown * np.float32(0.8), bare * min(rust, 1.0))
    rivets = np.zeros((n, n), dtype=np.uint8)
    for row in (round(0.06 * n), round(0.94 * n)):
        for column in range(n // 32, n, n // 16):
            cv2.circle(rivets, (column, row), 6, 255, -1, cv2.LINE_AA)
    heads = rivets.astype(np.float32) / np.float32(255)
    relief = noise.blurred(np.roll(heads, (-2, -1), (0, 1)) - np.roll(heads, (2, 1), (0, 1)), 1.2)
    image *= (1 + 0.45 * relief)[..., None]
    return Material(noise.finish(image), (3.0, 3.0), 0.5)


def asphalt(rng: np.random.Generator) -> Material:
    """Asphalt pavement, 4 m square: aggregate, patches, cracks."""
    n = 1024
    shade = 1 + 0.14 * noise.tiling((n, n), 2.2, rng) + 0.06 * noise.fractal((n, n), 400, rng, octaves=5)
    image = noise.paint((104, 104, 106), shade)
    cracks = np.abs(noise.fractal((n, n), 330, rng, octaves=4, gain=0.5)) < 0.012
    image = noise.blend(image, (52, 52, 54), 0.8 * noise.blurred(cracks.astype(np.float32), 1.0))
    return Material(noise.finish(image), (4.0, 4.0), 0.9)


def grass(rng: np.random.Generator) -> Material:
    """Meadow, 8 m square: blades, tufts, dry and bare patches, flowers."""
    n = 1536
    blades = noise.tiling((n, n), (7, 1.7), rng) + noise.tiling((n, n), (2.3, 5.3), rng)
    tufts = noise.fractal((n, n), 68, rng, octaves=5, gain=0.7)
    image = noise.paint((96, 112, 58), 1 + 0.16 * blades + 0.14 * tufts)
    dry = np.clip(noise.fractal((n, n), 315, rng, octaves=5, gain=0.65) - 0.1, 0, 1.4) / 1.4
    image = noise.blend(image, noise.paint((150, 140, 88), 1 + 0.15 * blades), 0.75 * dry)
    bare = np.clip((noise.fractal((n, n), 225, rng, octaves=6, gain=0.7) - 1.9) * 1.5, 0, 1)
    image = noise.blend(image, noise.paint((132, 110, 84), 1 + 0.12 * tufts), bare)
    flowers = np.clip(noise.tiling((n, n), 1.9, rng) - 3.6, 0, 0.5) * 2
    return Material(noise.finish(noise.blend(image, (226, 220, 170), flowers)), (8.0, 8.0), 1.0, soaks=True)


BLADES_PER_M2, BLADE_M, BLADE_PX = 5400, (0.03, 0.10), (3, 2, 2)
"""Blades that a meadow shows from above, drawn until they cover it; their lengths, m, and widths, px, of 2 mm: ryegrass
has blades 2 to 6 mm wide and 30 to 200 mm long (Hubbard 1984, Grasses)."""
BLADE_TONES, BLADE_BEND_RAD = 24, 0.5
"""Layers of blades, each brighter than the one below; standard deviation of the bend in the middle of a blade."""


def meadow(rng: np.random.Generator) -> Material:
    """Meadow drawn blade by blade, 4 m square, sharp from a metre away; dry and bare patches."""
    n, tile_m = 2048, 4.0
    per_m, count = n / tile_m, round(BLADES_PER_M2 * tile_m**2 / BLADE_TONES)
    margin = 8  # OpenCV does not smooth lines at an image's border
    drawn = np.full((n + 2 * margin, n + 2 * margin), 50, dtype=np.uint8)
    for layer in range(BLADE_TONES):
        foot, way, bend = rng.uniform(0, n, (count, 2)), rng.uniform(0, 2 * np.pi, count), rng.normal(0, 1, count)
        half = 0.5 * per_m * rng.uniform(*BLADE_M, count)[:, None]
        middle = foot + half * np.column_stack([np.cos(way), np.sin(way)])
        turned = way + BLADE_BEND_RAD * bend
        tip = middle + half * np.column_stack([np.cos(turned), np.sin(turned)])
        lines = _repeated(np.stack([foot, middle, tip], axis=1), n, margin) + margin
        tone, wide = 50 + 180 * (layer + 1) // BLADE_TONES, BLADE_PX[layer % len(BLADE_PX)]
        cv2.polylines(drawn, list(np.rint(16 * lines).astype(np.int32)), False, tone, wide, cv2.LINE_AA, 4)
    drawn = drawn[margin:-margin, margin:-margin]
    shade = drawn.astype(np.float32) / np.float32(drawn.mean())
    tufts = noise.fractal((n, n), 180, rng, octaves=4, gain=0.7)
    image = noise.paint((92, 108, 55), shade * (1 + 0.12 * tufts))
    dry = np.clip(noise.fractal((n, n), 700, rng, octaves=6, gain=0.65) - 0.1, 0, 1.4) / 1.4
    image = noise.blend(image, noise.paint((150, 140, 88), shade), 0.7 * dry)
    bare = np.clip((noise.fractal((n, n), 500, rng, octaves=7, gain=0.7) - 1.9) * 1.5, 0, 1)
    image = noise.blend(image, noise.paint((132, 110, 84), 1 + 0.12 * tufts), bare)
    return Material(noise.finish(image), (tile_m, tile_m), 1.0, soaks=True)


def _repeated(lines: Array, n: int, margin: int) -> Array:
    """Lines (k, points, 2) in a tile of n px, and their copies in neighbouring tiles, as far as margin px about it."""
    low, high = lines.min(axis=1) - margin, lines.max(axis=1) + margin
    shifts = [np.array([x, y]) for x in (-n, 0, n) for y in (-n, 0, n)]
    return np.concatenate([lines[((high + s > 0) & (low + s < n)).all(axis=1)] + s for s in shifts])


def gravel(rng: np.random.Generator) -> Material:
    """Crushed stone, 4 m square."""
    n = 1024
    stones = noise.tiling((n, n), 7, rng) + 0.7 * noise.tiling((n, n), 3.5, rng)
    image = noise.paint((150, 144, 134), 1 + 0.20 * stones + 0.05 * noise.fractal((n, n), 300, rng, octaves=4))
    return Material(noise.finish(image), (4.0, 4.0), 0.95)


def panels(rng: np.random.Generator, color: Color = (196.0, 192.0, 182.0)) -> Material:
    """Facade panels of 1.5 x 1.0 m with open joints; the texture covers 6 x 4 m."""
    h, w = 1024, 1536
    image = np.zeros((h, w, 3), dtype=np.float32)
    joint = np.zeros((h, w), dtype=np.float32)
    for row in range(4):
        for column in range(4):
            tone = np.array(color) * (1 + rng.normal(0, 0.02))
            image[row * h // 4 : (row + 1) * h // 4, column * w // 4 : (column + 1) * w // 4] = tone
            joint[:, column * w // 4 : column * w // 4 + 4] = 1
        joint[row * h // 4 : row * h // 4 + 4] = 1
    dirt = np.clip(noise.tiling((h, w), (300, 10), rng), 0, 3)
    image *= (1 + 0.02 * noise.fractal((h, w), 300, rng, octaves=6) - 0.03 * dirt)[..., None]
    image = noise.blend(image, (70, 68, 66), 0.9 * noise.blurred(joint, 0.8))
    return Material(noise.finish(image), (6.0, 4.0), 0.7)


def plaster(rng: np.random.Generator, color: Color = (206.0, 186.0, 150.0)) -> Material:
    """Rendered wall (plaster), 5 m square: grain and vertical weathering streaks."""
    n = 1024
    shade = 1 + 0.03 * noise.tiling((n, n), 2.5, rng) + 0.035 * noise.fractal((n, n), 400, rng, octaves=6)
    shade -= 0.03 * np.clip(noise.tiling((n, n), (400, 12), rng) - 0.5, 0, 3)
    return Material(noise.finish(noise.paint(color, shade)), (5.0, 5.0), 0.95)


def window(rng: np.random.Generator, panes: tuple[int, int] = (2, 2), frame: Color = (232.0, 230.0, 224.0)) -> Material:
    """A window, stretched to its opening: reflected sky, curtains in some, a frame, panes (columns, rows)."""
    h, w = 384, 288
    y = np.linspace(0, 1, h, dtype=np.float32)[:, None] * np.ones((1, w), dtype=np.float32)
    image = noise.paint((64, 78, 92), 1.5 - y)
    clouds = np.clip(noise.fractal((h, w), 160, rng, octaves=4), 0, 1)
    image = noise.blend(image, (176, 188, 198), 0.40 * clouds * (1 - 0.6 * y))
    trees = (y > 0.62 + 0.05 * noise.tiling((1, w), 30, rng)).astype(np.float32)
    image = noise.blend(image, (40, 48, 38), 0.55 * noise.blurred(trees, 1))
    if rng.random() < 0.6:
        waves = np.arange(w, dtype=np.float32) * np.float32(rng.uniform(0.2, 0.35))
        folds = np.asarray(np.ones((h, 1)) * (1 + 0.10 * np.sin(waves)), dtype=np.float32)
        width = int(rng.uniform(0.15, 0.4) * w)
        cover = np.zeros((h, w), dtype=np.float32)
        cover[:, :width] = cover[:, w - width :] = 0.5
        image = noise.blend(image, noise.paint((196, 190, 178), folds), cover)
    bars = np.zeros((h, w), dtype=np.float32)
    thick = 9
    for k in range(panes[0] + 1):
        at = round(k * (w - thick) / panes[0])
        bars[:, at : at + thick] = 1
    for k in range(panes[1] + 1):
        at = round(k * (h - thick) / panes[1])
        bars[at : at + thick] = 1
    shadow = np.clip(np.roll(bars, (4, 3), (0, 1)) - bars, 0, 1)
    image = noise.blend(image * (1 - 0.5 * shadow)[..., None], frame, noise.blurred(bars, 0.6))
    return Material(noise.finish(image), (1.0, 1.0), 0.25)


def door(rng: np.random.Generator, color: Color = (84.0, 58.0, 44.0)) -> Material:
    """A panelled wooden door, stretched to its opening."""
    h, w = 512, 256
    grain = 1 + 0.06 * noise.tiling((h, w), (120, 3), rng) + 0.03 * noise.tiling((h, w), 3, rng)
    image = noise.paint(color, grain)
    drawn = np.zeros((h, w), dtype=np.uint8)
    for low, high in ((0.06, 0.42), (0.50, 0.92)):
        cv2.rectangle(drawn, (round(0.14 * w), round(low * h)), (round(0.86 * w), round(high * h)), 255, 5)
    lines = noise.blurred(drawn.astype(np.float32) / np.float32(255), 1.0)
    image *= (1 - 0.45 * lines + 0.35 * np.roll(lines, (4, 4), (0, 1)))[..., None]
    return Material(noise.finish(image), (1.0, 1.0), 0.5)


def cloth(rng: np.random.Generator, color: Color) -> Material:
    """Woven cloth with folds, 1 m square."""
    n = 256
    shade = 1 + 0.14 * noise.tiling((n, n), (60, 12), rng) + 0.05 * noise.tiling((n, n), 1.5, rng)
    return Material(noise.finish(noise.paint(color, shade)), (1.0, 1.0), 0.95)


def bark(rng: np.random.Generator) -> Material:
    """Tree bark, 1 m square."""
    n = 256
    ridges = noise.tiling((n, n), (50, 5), rng) + 0.5 * noise.tiling((n, n), (14, 3), rng)
    return Material(
        noise.finish(noise.paint((98, 82, 66), np.asarray(1 + 0.24 * ridges, dtype=np.float32))), (1.0, 1.0), 1.0
    )


def birch_bark(rng: np.random.Generator) -> Material:
    """White bark of birches with dark lenticels across it and darker, fissured patches, 1 m square."""
    n = 256
    image = noise.paint((206, 202, 192), np.asarray(1 + 0.05 * noise.tiling((n, n), (6, 30), rng), dtype=np.float32))
    lenticels = np.clip(noise.tiling((n, n), (2.5, 16), rng) - 1.5, 0, 0.6) / 0.6
    fissures = np.clip(noise.fractal((n, n), 60, rng, octaves=4, gain=0.65) - 0.9, 0, 0.5) * 2
    image = noise.blend(image, (74, 68, 62), np.asarray(0.8 * np.maximum(lenticels, fissures), dtype=np.float32))
    return Material(noise.finish(image), (1.0, 1.0), 1.0)


PAINTS: dict[str, Callable[[np.random.Generator], Material]] = {
    "concrete": concrete,
    "brick": brick,
    "painted-steel": painted_steel,
    "asphalt": asphalt,
    "grass": grass,
    "meadow": meadow,
    "gravel": gravel,
    "panels": panels,
    "plaster": plaster,
}
"""Materials by the names used in configs."""
