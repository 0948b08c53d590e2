"""A cardboard box: kraft paper, flaps, tape, handling symbols and a shipping label."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Gt, Interval
from numpy.typing import NDArray

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.painted import UNPAINTED
from uavbench.scenes.materials.procedural_texture import Image
from uavbench.scenes.primitives.meshes import box, panel
from uavbench.scenes.renderables import STRUCTURE, BuiltStructure, Part, Texture
from uavbench.scenes.structure import Structure

PX_PER_M = 1600
INK = (46.0, 40.0, 40.0)
TAPE = (176.0, 138.0, 92.0)
Drawing = NDArray[np.uint8]
Painter = Callable[[tuple[float, float], np.random.Generator], Image]
"""Draws a face of a size (height, width) in metres."""
WORDS = ("FRAGILE", "THIS SIDE UP", "HANDLE WITH CARE", "KEEP DRY", "MADE IN EU", "DO NOT STACK")


@dataclass(frozen=True)
class Box:
    """A closed cardboard box standing on the ground, its length along x."""

    length_m: Annotated[float, Gt(0), Interval(le=5)] = 0.40
    width_m: Annotated[float, Gt(0), Interval(le=5)] = 0.30
    height_m: Annotated[float, Gt(0), Interval(le=5)] = 0.30

    def build(self, rng: np.random.Generator) -> BuiltStructure:
        """The box centred above the origin, with its six printed faces."""
        return self._covered(lambda painted, size_m: noise.finish(painted(size_m, rng)))

    def unpainted(self) -> BuiltStructure:
        """The structure in one plain material: its geometry without the time of painting."""
        return self._covered(lambda painted, size_m: UNPAINTED.texture)

    def _covered(self, texture_of: Callable[[Painter, tuple[float, float]], Texture]) -> BuiltStructure:
        x, y, z = self.length_m / 2, self.width_m / 2, self.height_m
        structure = Structure.from_mesh(*box((-x, -y, 0), (x, y, z)))
        faces = [
            ((-x, -y, 0), (2 * x, 0, 0), (0, 0, z), _side),
            ((x, -y, 0), (0, 2 * y, 0), (0, 0, z), _end),
            ((x, y, 0), (-2 * x, 0, 0), (0, 0, z), _side),
            ((-x, y, 0), (0, -2 * y, 0), (0, 0, z), _end),
            ((-x, -y, z), (2 * x, 0, 0), (0, 2 * y, 0), _top),
            ((-x, y, 0), (2 * x, 0, 0), (0, -2 * y, 0), _plain),
        ]
        parts = []
        for origin, u, v, painted in faces:
            vertices, triangles, uv = panel(origin, u, v, 0.1)
            size = (float(np.linalg.norm(v)), float(np.linalg.norm(u)))
            texture = texture_of(painted, size)
            normals = np.broadcast_to(np.cross(u, v) / (size[0] * size[1]), vertices.shape)
            parts.append(
                Part(
                    vertices=vertices,
                    triangles=triangles,
                    normals=normals,
                    uv=_inside(uv, texture),
                    texture=texture,
                    roughness=0.75,
                    instance=STRUCTURE,
                )
            )
        return BuiltStructure(structure, tuple(parts))


def _inside(uv: np.ndarray, texture: Texture) -> np.ndarray:
    """Texture coordinates inset by half a texel, against bleeding across the border of the repeated texture."""
    size = np.array([texture.shape[1], texture.shape[0]])
    return np.asarray((uv * (size - 1) + 0.5) / size)


def _px(length_m: float) -> int:
    return max(1, round(length_m * PX_PER_M))


def _plain(size_m: tuple[float, float], rng: np.random.Generator) -> Image:
    """Kraft paper on corrugated board: blotches, fibres, flutes, worn edges."""
    h, w = max(16, _px(size_m[0])), max(16, _px(size_m[1]))
    shade = 1 + 0.030 * noise.fractal((h, w), 160, rng, octaves=6, gain=0.55)
    fibres = noise.tiling((h, w), (2, 14), rng) + 0.5 * noise.tiling((h, w), (5, 2), rng)
    shade += 0.018 * fibres + 0.018 * noise.tiling((h, w), 1.6, rng)
    flutes = np.sin(2 * np.pi * np.arange(w) / (0.0072 * PX_PER_M) + rng.uniform(0, 6))
    shade += 0.010 * flutes.astype(np.float32) * (1 + 0.5 * noise.tiling((h, w), (200, 30), rng))
    specks = noise.tiling((h, w), 2.5, rng)
    shade -= 0.10 * np.clip(specks - 2.9, 0, 1) - 0.05 * np.clip(-specks - 3.0, 0, 1)
    image = noise.paint((196, 160, 116), shade)
    warm = noise.fractal((h, w), 300, rng, octaves=2)
    image += warm[..., None] * np.array([1.0, 0.0, -2.0], dtype=np.float32)
    yy, xx = np.ogrid[:h, :w]
    border = np.minimum(np.minimum(xx, w - 1 - xx), np.minimum(yy, h - 1 - yy)).astype(np.float32) / PX_PER_M
    worn = np.clip(1 - border / (0.0022 + 0.0012 * np.clip(noise.tiling((h, w), 30, rng), -1, 2)), 0, 1)
    image = noise.blend(image, (216, 184, 142), 0.65 * worn)
    crease = np.clip(1 - np.abs(border - 0.004) / 0.002, 0, 1)
    return noise.blend(image, (160, 124, 84), 0.16 * crease)


def _share(mask: Drawing) -> Image:
    return mask.astype(np.float32) / np.float32(255)


def _stamp(image: Image, mask: Drawing, color: tuple[float, float, float], rng: np.random.Generator) -> Image:
    """Image with the mask printed in one colour, unevenly, with some paper showing through."""
    cover = 0.86 + 0.07 * noise.tiling(mask.shape, 5, rng) + 0.05 * noise.tiling(mask.shape, 40, rng)
    return noise.blend(image, color, np.clip(noise.blurred(_share(mask), 0.7) * cover, 0, 1))


def _text(mask: Drawing, text: str, at: tuple[int, int], height_px: float, bold: float = 0.12) -> None:
    scale = height_px / 22.0
    thick = max(1, round(height_px * bold))
    cv2.putText(mask, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, thick, cv2.LINE_AA)


def _arrows(mask: Drawing, x: int, y: int, size: int) -> None:
    """The handling symbol "this way up": two arrows over a bar (ISO 780, symbol 3)."""
    for k in (0, 1):
        cx = x + round((0.28 + 0.44 * k) * size)
        shaft = round(0.05 * size)
        cv2.rectangle(mask, (cx - shaft, y + round(0.30 * size)), (cx + shaft, y + round(0.82 * size)), 255, -1)
        tip = np.array([[cx, y + round(0.06 * size)], [cx - 3 * shaft, y + round(0.34 * size)]])
        cv2.fillPoly(mask, [np.vstack([tip, [[cx + 3 * shaft, y + round(0.34 * size)]]])], 255, cv2.LINE_AA)
    cv2.rectangle(mask, (x, y + round(0.88 * size)), (x + size, y + round(0.95 * size)), 255, -1)


def _glass(mask: Drawing, x: int, y: int, size: int) -> None:
    """The handling symbol "fragile": a broken wine glass (ISO 780, symbol 1)."""
    bowl = np.array([[0.2, 0.05], [0.8, 0.05], [0.74, 0.42], [0.56, 0.56], [0.44, 0.56], [0.26, 0.42]]) * size
    cv2.fillPoly(mask, [np.rint(bowl + np.array([x, y])).astype(np.int32)], 255, cv2.LINE_AA)
    crack = np.array([[0.5, 0.05], [0.42, 0.2], [0.54, 0.28], [0.46, 0.42]]) * size
    cv2.polylines(mask, [np.rint(crack + np.array([x, y])).astype(np.int32)], False, 0, max(1, size // 28), cv2.LINE_AA)
    cv2.rectangle(
        mask,
        (x + round(0.47 * size), y + round(0.55 * size)),
        (x + round(0.53 * size), y + round(0.86 * size)),
        255,
        -1,
    )
    cv2.rectangle(
        mask,
        (x + round(0.27 * size), y + round(0.86 * size)),
        (x + round(0.73 * size), y + round(0.94 * size)),
        255,
        -1,
    )


def _side(size_m: tuple[float, float], rng: np.random.Generator) -> Image:
    """A long side: handling symbols, text and a shipping label."""
    image = _plain(size_m, rng)
    h, w = image.shape[:2]
    mask = np.zeros((h, w), dtype=np.uint8)
    mark = round(0.20 * h)
    top = round(0.10 * h)
    left = round(rng.uniform(0.06, 0.12) * w)
    _arrows(mask, left, top, mark)
    _glass(mask, left + round(1.25 * mark), top, mark)
    _text(mask, WORDS[int(rng.integers(len(WORDS)))], (left, round(0.46 * h)), 0.075 * h)
    code = "".join(str(d) for d in rng.integers(0, 10, 9))
    _text(mask, f"ART. {code[:4]}-{code[4:]}", (left, round(0.86 * h)), 0.035 * h, 0.10)
    _text(mask, f"QTY {code[:2]}   {int(rng.integers(3, 19))} KG", (left, round(0.93 * h)), 0.035 * h, 0.10)
    image = _stamp(image, mask, INK, rng)
    return _label(image, round(rng.uniform(0.54, 0.6) * w), round(rng.uniform(0.4, 0.5) * h), round(0.36 * w), rng)


def _label(image: Image, x: int, y: int, width: int, rng: np.random.Generator) -> Image:
    """A white label with lines of text and a barcode, slightly rotated."""
    height = round(0.62 * width)
    h, w = image.shape[:2]
    sheet = np.full((height, width), 0.95, dtype=np.float32)
    cv2.rectangle(sheet, (4, 4), (width - 5, height - 5), 0.25, 2)
    cv2.line(sheet, (4, round(0.48 * height)), (width - 5, round(0.48 * height)), 0.25, 2)
    for row in range(4):
        length = rng.uniform(0.3, 0.6) * width
        at = round((0.12 + 0.09 * row) * height)
        step = 0.016 * width
        for k in range(int(length / step)):
            if rng.random() > 0.18:
                left = round(0.06 * width + k * step)
                cv2.rectangle(sheet, (left, at), (left + round(0.6 * step), at + round(0.045 * height)), 0.2, -1)
    bar = round(0.08 * width)
    while bar < 0.92 * width:
        thick = int(rng.integers(1, 5)) * max(1, width // 220)
        cv2.rectangle(sheet, (bar, round(0.55 * height)), (bar + thick - 1, round(0.86 * height)), 0.08, -1)
        bar += thick + int(rng.integers(1, 5)) * max(1, width // 220)
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), float(rng.normal(0, 1.2)), 1.0)
    turn[:, 2] += [x, min(y, h - height - 8)]
    cover = cv2.warpAffine(np.ones_like(sheet), turn, (w, h), flags=cv2.INTER_LINEAR)
    ink = cv2.warpAffine(sheet, turn, (w, h), flags=cv2.INTER_AREA)
    grain = 1 + 0.012 * noise.tiling((h, w), 8, rng)
    return noise.blend(image, noise.paint((240, 240, 236), ink * grain), np.asarray(cover, dtype=np.float32))


def _tape(image: Image, low: int, high: int, start: int, stop: int, rng: np.random.Generator) -> Image:
    """Brown tape over rows low..high and columns start..stop, wrinkled, with torn ends."""
    h, w = image.shape[:2]
    yy, xx = (each.astype(np.float32) for each in np.ogrid[:h, :w])
    tear = 3 * np.sign(np.sin(yy * 0.9)) + 2 * noise.tiling((h, w), 12, rng)
    mask = (yy > low) & (yy < high) & (xx > start + tear) & (xx < stop - tear)
    gloss = 1 + 0.05 * noise.tiling((h, w), (6, 160), rng) + 0.03 * noise.tiling((h, w), (40, 8), rng)
    border = np.minimum(np.abs(yy - low), np.abs(yy - high))[:, 0] < 1.6
    layer = noise.paint(TAPE, gloss)
    layer[border] = layer[border] * np.float64(0.86)
    return noise.blend(image, layer, noise.blurred(mask.astype(np.float32), 0.6) * 0.82)


def _top(size_m: tuple[float, float], rng: np.random.Generator) -> Image:
    """The top: two flaps meeting in the middle, taped."""
    image = _plain(size_m, rng)
    h, w = image.shape[:2]
    middle = h / 2 + 0.0016 * PX_PER_M * noise.tiling((1, w), 500, rng)[0] * 0.4
    away = np.abs(np.arange(h, dtype=np.float32)[:, None] - middle) / PX_PER_M
    image = noise.blend(image, (210, 176, 132), 0.5 * np.clip(1 - np.abs(away - 0.0025) / 0.0015, 0, 1))
    image = noise.blend(image, (44, 32, 22), np.clip(1.6 - away / 0.0007, 0, 1))
    half = round(0.024 * PX_PER_M)
    return _tape(image, round(h / 2) - half, round(h / 2) + half, -20, w + 20, rng)


def _end(size_m: tuple[float, float], rng: np.random.Generator) -> Image:
    """A short side: the end of the tape, a hand hole, small print."""
    image = _plain(size_m, rng)
    h, w = image.shape[:2]
    drawn = np.zeros((h, w), dtype=np.uint8)
    centre, axes = (w // 2, round(0.40 * h)), (round(0.14 * w), round(0.045 * h))
    cv2.ellipse(drawn, centre, axes, 0, 0, 360, 255, -1, cv2.LINE_AA)
    hole = _share(drawn)
    rim = np.clip(noise.blurred(hole, 3) * 2, 0, 1) - hole
    image = noise.blend(image, (214, 182, 140), 0.7 * np.clip(rim, 0, 1))
    depth = np.clip(0.5 + (np.arange(h, dtype=np.float32)[:, None] - centre[1]) / axes[1] / 2, 0, 1) * np.ones((1, w))
    image = noise.blend(image, noise.paint((70, 50, 34), (0.35 + 0.5 * depth).astype(np.float32)), hole)
    half, reach = round(0.024 * PX_PER_M), round(0.055 * PX_PER_M)
    image = np.ascontiguousarray(
        _tape(np.ascontiguousarray(image.transpose(1, 0, 2)), w // 2 - half, w // 2 + half, -20, reach, rng).transpose(
            1, 0, 2
        )
    )
    mask = np.zeros((h, w), dtype=np.uint8)
    code = "".join(str(d) for d in rng.integers(0, 10, 6))
    _text(mask, f"LOT {code}", (round(0.10 * w), round(0.72 * h)), 0.04 * h, 0.10)
    _text(mask, f"{code[:2]}x{code[2:4]}x{code[4:]} cm", (round(0.10 * w), round(0.80 * h)), 0.04 * h, 0.10)
    cv2.circle(mask, (round(0.78 * w), round(0.78 * h)), round(0.09 * w), 255, max(2, w // 120), cv2.LINE_AA)
    cv2.circle(mask, (round(0.78 * w), round(0.78 * h)), round(0.07 * w), 255, max(1, w // 300), cv2.LINE_AA)
    _text(mask, "ECT 32", (round(0.735 * w), round(0.79 * h)), 0.03 * h, 0.10)
    return _stamp(image, mask, INK, rng)
