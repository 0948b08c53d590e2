"""Furniture along the walls of a room: tables, cabinets, shelves with books, chairs, a radiator below the window."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import Color
from uavbench.scenes.primitives.meshes import merged, panel
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories.pose import Array, rotation_exp

CORNER_M = 0.7
"""Distance from the corners of the room within which nothing stands: a piece of the next wall may."""
PX_PER_M = 240
"""Texels per metre of a front: as many as pixels of 65 degrees and 640 px see of it at 2 m."""
GAP_M = (0.12, 0.5)
"""Range of the gaps between pieces, by eye."""
LAMP = 0.6
"""Part of the lamp's light that reaches a wall of the room."""
DARKEST, DARK_BELOW_M = 0.62, 0.5
"""Ambient light at the floor beside a wall, over that in the open, and the height below which it is less: by eye."""
WOODS: tuple[Color, ...] = ((174.0, 140.0, 100.0), (128.0, 92.0, 62.0), (206.0, 186.0, 152.0))
LACQUER: Color = (228.0, 227.0, 222.0)
METAL: Color = (92.0, 94.0, 98.0)
SPINES: tuple[Color, ...] = (
    (150.0, 52.0, 44.0), (46.0, 74.0, 116.0), (58.0, 96.0, 72.0), (208.0, 196.0, 168.0),
    (188.0, 148.0, 66.0), (70.0, 66.0, 72.0), (214.0, 214.0, 210.0), (118.0, 86.0, 118.0),
)  # fmt: skip
"""sRGB colours (0..255) of wood, of white lacquer, of metal, and of the backs of books and files."""
TABLE_HIGH_M = 0.74
"""Height of a table (EN 527-1: 0.72 to 0.76 m)."""
SEAT_M, BACK_M = 0.46, 0.88
"""Heights of the seat of a chair and of its back (EN 1729-1, size 6: a seat of 0.46 m)."""
RADIATOR_M, RADIATOR_HIGH_M = (1.0, 1.4), 0.6
"""Widths and height of a common panel radiator."""


@dataclass(frozen=True)
class Span:
    """A stretch of a wall: where it begins and ends, metres to the right of its left corner."""

    begin: float
    end: float

    def meets(self, other: "Span") -> bool:
        """Whether they have a place in common."""
        return self.begin < other.end and other.begin < self.end


@dataclass(frozen=True)
class Wall:
    """A wall of a room: its number of right angles around, what may not be covered, and the least height of what hangs
    there, metres.
    """

    turns: int
    kept: tuple[Span, ...] = ()
    free_below_m: float = np.inf


@dataclass(frozen=True)
class Block:
    """A box before a wall: its left end, width and depth, heights of its lower and upper side, distance from it, m."""

    left: float
    wide: float
    deep: float
    low: float
    high: float
    off: float = 0.0


def furniture(side: float, walls: Sequence[Wall], share: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """Pieces along a share of the walls of a room with sides in metres, whose middle is at the origin."""
    looks = [*(_wood(color, rng) for color in WOODS), _plain(LACQUER)]
    return merged(part for wall in walls for part in _pieces(side, wall, share, looks, rng))


def _pieces(
    side: float, wall: Wall, share: float, looks: Sequence[Texture], rng: np.random.Generator
) -> Iterable[Part]:
    """Pieces along a wall, before it is turned."""
    at = CORNER_M + float(rng.uniform(*GAP_M))
    while True:
        kind = KINDS[int(rng.integers(len(KINDS)))]
        place = Block(at, float(rng.uniform(*kind.wide_m)), 0.0, 0.0, float(rng.uniform(*kind.high_m)))
        look, taken = looks[int(rng.integers(len(looks)))], Span(at, at + place.wide)
        if taken.end > side - CORNER_M:
            return
        if (kept := next((span for span in wall.kept if taken.meets(span)), None)) is not None:
            at = kept.end
            continue
        if rng.uniform() < share and place.high < wall.free_below_m:
            for part in kind.build(place, look, rng):
                yield _moved(part, side, wall)
        at = taken.end + float(rng.uniform(*GAP_M))


def _moved(part: Part, side: float, wall: Wall) -> Part:
    """A part before a wall, whose left corner is the origin, whose right is along x and whose back is along y."""
    turn = rotation_exp(np.array([0.0, 0.0, wall.turns * np.pi / 2]))
    return replace(part, vertices=np.add(part.vertices, [-side / 2, side / 2, 0.0]) @ turn.T)


def radiator(side: float, wall: Wall, middle: float, rng: np.random.Generator) -> tuple[Part, ...]:
    """A panel radiator at a wall about a place, metres to the right of its left corner."""
    wide = float(rng.uniform(*RADIATOR_M))
    block = Block(middle - wide / 2, wide, 0.10, 0.14, 0.14 + RADIATOR_HIGH_M, 0.03)
    return merged(_moved(part, side, wall) for part in _block(block, _plain(LACQUER), _ribs(wide)))


def _table(place: Block, look: Texture, rng: np.random.Generator) -> list[Part]:
    """A table on four legs, with files, boxes or a screen on it."""
    deep, top = float(rng.uniform(0.6, 0.8)), TABLE_HIGH_M
    left, right = place.left, place.left + place.wide
    parts = _block(Block(left, place.wide, deep, top - 0.03, top), look)
    metal = _plain(METAL)
    for x in (left + 0.05, right - 0.10):
        for off in (0.04, deep - 0.09):
            parts += _block(Block(x, 0.05, 0.05, 0.0, top - 0.03, off), metal)
    if rng.uniform() < 0.5:
        x = left + place.wide * float(rng.uniform(0.3, 0.5))
        dark = _plain((38.0, 40.0, 44.0))
        parts += _block(Block(x - 0.06, 0.12, 0.12, top, top + 0.12, 0.2), dark)
        parts += _block(Block(x - 0.27, 0.54, 0.04, top + 0.12, top + 0.46, 0.24), dark, _screen(rng))
    x = left + 0.06
    for _ in range(int(rng.integers(1, 4))):
        wide, high = float(rng.uniform(0.12, 0.32)), float(rng.uniform(0.05, 0.26))
        color = SPINES[int(rng.integers(len(SPINES)))]
        parts += _block(Block(x, wide, float(rng.uniform(0.15, 0.3)), top, top + high, 0.05), _plain(color))
        x += wide + float(rng.uniform(0.05, 0.4))
        if x > right - 0.35:
            break
    return parts


def _cabinet(place: Block, look: Texture, rng: np.random.Generator) -> list[Part]:
    """A cabinet with doors or drawers."""
    block = replace(place, deep=float(rng.uniform(0.38, 0.5)))
    return _block(block, look, _doors(block, look, rng))


def _shelf(place: Block, look: Texture, rng: np.random.Generator) -> list[Part]:
    """A shelf with books and files, whose backs are painted on its front."""
    block = replace(place, deep=float(rng.uniform(0.26, 0.34)))
    return _block(block, look, _books(block, look, rng))


def _chair(place: Block, look: Texture, rng: np.random.Generator) -> list[Part]:
    """A chair with its back to the room."""
    left, wide, off = place.left, place.wide, float(rng.uniform(0.05, 0.3))
    metal = _plain(METAL)
    parts = _block(Block(left, wide, 0.42, SEAT_M - 0.03, SEAT_M, off), look)
    for x in (left, left + wide - 0.03):
        parts += _block(Block(x, 0.03, 0.03, 0.0, SEAT_M - 0.03, off + 0.01), metal)
        parts += _block(Block(x, 0.03, 0.03, 0.0, BACK_M, off + 0.39), metal)
    return parts + _block(Block(left, wide, 0.02, SEAT_M + 0.16, BACK_M, off + 0.40), look)


def _block(block: Block, look: Texture, front: Texture | None = None) -> list[Part]:
    """Five faces of a box, all but the one at the wall: its front, and the others of one look."""
    x, w, low, high = block.left, block.wide, block.low, block.high
    near, far = -block.off, -block.off - block.deep
    up, deep = high - low, block.deep
    faces = [
        panel((x, far, low), (w, 0, 0), (0, 0, up), 9.0),
        panel((x, far, high), (w, 0, 0), (0, deep, 0), 9.0),
        panel((x, near, low), (w, 0, 0), (0, -deep, 0), 9.0),
        panel((x, near, low), (0, -deep, 0), (0, 0, up), 9.0),
        panel((x + w, far, low), (0, deep, 0), (0, 0, up), 9.0),
    ]
    sizes = [(w, up), (w, deep), (w, deep), (deep, up), (deep, up)]
    parts = []
    for k, ((vertices, triangles, uv), size) in enumerate(zip(faces, sizes, strict=True)):
        shade = DARKEST + (1 - DARKEST) * np.clip(vertices[:, 2:] / DARK_BELOW_M, 0, 1)
        tint = np.column_stack([np.repeat(shade, 3, axis=1), np.full(len(vertices), LAMP)])
        own = k == 0 and front is not None
        parts.append(
            Part(
                vertices=vertices,
                triangles=triangles,
                uv=uv if own else uv * size,
                texture=front if own else look,
                tint=tint,
                roughness=0.6,
            )
        )
    return parts


def _plain(color: Color) -> Texture:
    return np.full((8, 8, 3), color, dtype=np.uint8)


def _wood(color: Color, rng: np.random.Generator) -> Texture:
    """Veneer, 1 m square, its grain across."""
    n = PX_PER_M
    grain = 1 + 0.05 * noise.tiling((n, n), (3, 90), rng) + 0.04 * noise.tiling((n, n), (14, 200), rng)
    return noise.finish(noise.paint(color, np.asarray(grain, dtype=np.float32)))


def _front(block: Block, look: Texture) -> Texture:
    """A front of the look, to be painted on."""
    rows, columns = (max(8, round(size * PX_PER_M)) for size in (block.high - block.low, block.wide))
    repeats = (-(-rows // len(look)), -(-columns // look.shape[1]), 1)
    return np.ascontiguousarray(np.tile(look, repeats)[:rows, :columns])


def _doors(block: Block, look: Texture, rng: np.random.Generator) -> Texture:
    """Doors side by side, or drawers one above the other, with gaps and handles."""
    image = _front(block, look)
    h, w = image.shape[:2]
    across, down = (round(block.wide / 0.45), 1) if rng.uniform() < 0.6 else (round(block.wide / 0.7), 3)
    for column in range(across):
        for row in range(down):
            x0, x1 = column * w // across, (column + 1) * w // across - 1
            y0, y1 = row * (h - 14) // down, (row + 1) * (h - 14) // down - 1
            cv2.rectangle(image, (x0, y0), (x1, y1), (52, 46, 40), 2)
            at = ((x0 + x1) // 2 - 16, y0 + 12) if down > 1 else (x1 - 14 if column % 2 == 0 else x0 + 8, y0 + h // 3)
            size = (32, 5) if down > 1 else (6, 34)
            cv2.rectangle(image, at, (at[0] + size[0], at[1] + size[1]), (150, 150, 152), -1)
    cv2.rectangle(image, (0, h - 14), (w - 1, h - 1), (44, 42, 40), -1)
    return image


def _books(block: Block, look: Texture, rng: np.random.Generator) -> Texture:
    """Shelves with backs of books and files, and gaps between them."""
    image = _front(block, look)
    h, w = image.shape[:2]
    board, rows = 6, round((block.high - block.low) / 0.36)
    for row in range(rows):
        y0, y1 = row * h // rows + board, (row + 1) * h // rows - 1
        cv2.rectangle(image, (board, y0), (w - board - 1, y1), (30, 26, 24), -1)
        x = board + int(rng.integers(0, 12))
        while x < w - board - 4:
            wide = int(rng.integers(4, 17))
            if rng.uniform() < 0.12:
                x += 3 * wide
                continue
            high = int((y1 - y0) * rng.uniform(0.55, 0.95))
            color = np.array(SPINES[int(rng.integers(len(SPINES)))]) * rng.uniform(0.7, 1.1)
            drawn = [int(c) for c in color.clip(0, 255)]
            end = min(x + wide, w - board - 1)
            cv2.rectangle(image, (x, y1 - high), (end - 1, y1), drawn, -1)
            label = y1 - int(high * rng.uniform(0.55, 0.8))
            cv2.line(image, (x + 1, label), (end - 2, label), [min(255, c + 60) for c in drawn], 2)
            x = end + 1
    return image


def _screen(rng: np.random.Generator) -> Texture:
    """A screen that is off, and reflects the room."""
    glow = 1 + 0.25 * noise.fractal((80, 130), 60, rng, octaves=2)
    image = noise.finish(noise.paint((26.0, 28.0, 32.0), np.asarray(glow, dtype=np.float32)))
    cv2.rectangle(image, (0, 0), (129, 79), (18, 18, 20), 3)
    return image


def _ribs(wide: float) -> Texture:
    """The front of a panel radiator: vertical grooves."""
    columns = round(wide * PX_PER_M)
    groove = 0.93 + 0.07 * np.cos(2 * np.pi * np.arange(columns) / 8)
    rows: Array = np.broadcast_to(groove, (round(RADIATOR_HIGH_M * PX_PER_M), columns))
    return noise.finish(noise.paint(LACQUER, np.asarray(rows, dtype=np.float32)))


@dataclass(frozen=True)
class Kind:
    """A kind of furniture: ranges of its width and height, metres, and the function that builds it."""

    wide_m: tuple[float, float]
    high_m: tuple[float, float]
    build: Callable[[Block, Texture, np.random.Generator], list[Part]]


KINDS = (
    Kind((1.2, 1.6), (TABLE_HIGH_M, TABLE_HIGH_M), _table),
    Kind((0.8, 1.4), (0.72, 1.05), _cabinet),
    Kind((0.7, 1.1), (1.75, 2.05), _shelf),
    Kind((0.44, 0.44), (BACK_M, BACK_M), _chair),
)
"""Furniture of an office or a flat, by eye."""
