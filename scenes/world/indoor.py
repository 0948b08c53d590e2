"""An indoor environment: floor, walls with a door, a window and pictures, ceiling, and a ceiling lamp."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.materials.procedural_texture import Image
from uavbench.scenes.primitives.meshes import panel
from uavbench.scenes.renderables import BuiltEnvironment, BuiltStructure, Confines, Light, Part, Room, Streams
from uavbench.scenes.world.furniture import Span, Wall, furniture, radiator
from uavbench.trajectories.pose import Array, rotation_exp

TILE_M = 2.4
TILE_PX = 1536
SKIRTING_M = 0.09
DOOR_WALL, WINDOW_WALL = 0, 2
"""Right angles around of the walls with the door and the window; the other two have pictures."""
BESIDE_M = 0.15
"""Clear distance on either side of a door and a window."""


@dataclass(frozen=True)
class Indoor:
    """A room around the structure at a random heading, lit by an area lamp under the ceiling.

    sharp_textures takes finer mipmaps. furniture is the share of the walls along which tables, cabinets, shelves and
    chairs stand; more than 0 also puts a radiator below the window.
    """

    floor: Literal["planks", "carpet", "concrete"] = "planks"
    room_m: Annotated[float, Gt(1), Interval(le=60)] = 7.0
    height_m: Annotated[float, Gt(1), Interval(le=20)] = 2.8
    brightness: Annotated[float, Gt(0), Interval(le=10)] = 1.0
    sharp_textures: bool = False
    furniture: Annotated[float, Interval(ge=0, le=1)] = 0.0

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltEnvironment:
        """The room around a structure of bounds (2, 3) in metres, enlarged if the structure does not fit."""
        centre, extent = bounds.mean(axis=0), _extent_m(bounds)
        room = self._room(bounds, rng)
        side, height, turn, place = room.side_m, room.height_m, room.turn, room.place
        parts, walls = self._floor(side, centre - place, extent, turn, rng), _walls(side, height, rng)
        parts += walls.parts
        if self.furniture > 0:
            (own,) = rng.spawn(1)
            parts += furniture(side, walls.free, self.furniture, own)
            parts += radiator(side, walls.free[WINDOW_WALL], walls.window_m, own)
        moved = tuple(replace(p, vertices=p.vertices @ turn.T + place, casts_shadow=False) for p in parts)
        b = self.brightness
        tilt, bearing = rng.uniform(0.3, 0.6), rng.uniform(0, 2 * np.pi)
        light = Light(
            to_lamp=(float(tilt * np.cos(bearing)), float(tilt * np.sin(bearing)), 1.0),
            lamp=(0.60 * b, 0.575 * b, 0.53 * b),
            above=(0.40 * b, 0.40 * b, 0.39 * b),
            below=(0.20 * b, 0.175 * b, 0.15 * b),
            shadow_map=False,
            softness_m=0.25 * extent,
        )
        return BuiltEnvironment(moved, light, sharp=self.sharp_textures, room=room)

    def confines(self, built: BuiltStructure, rng: np.random.Generator, streams: Streams) -> Confines:
        """The room that `build` draws from the same generator."""
        return Confines(room=self._room(built.structure.bounds, rng))

    def _room(self, bounds: Array, rng: np.random.Generator) -> Room:
        """The room, the first that is drawn."""
        centre, extent = bounds.mean(axis=0), _extent_m(bounds)
        side, height = max(self.room_m, 4 * extent), max(self.height_m, 1.6 * float(bounds[1, 2]))
        turn = rotation_exp(np.array([0.0, 0.0, rng.uniform(0.15, 1.3)]))
        place = np.array([*(centre[:2] + rng.uniform(-0.1, 0.1, 2) * side), 0.0])
        return Room(side, height, turn, place)

    def _floor(
        self, side: float, structure_at: Array, extent: float, turn: Array, rng: np.random.Generator
    ) -> list[Part]:
        """The floor in two meshes: the region that receives the structure's shadow, with a lightmap, and the rest."""
        painted = {"planks": _planks, "carpet": _carpet, "concrete": _concrete}[self.floor](rng)
        near, half, middle = side / 2, 1.8 * extent, (structure_at @ turn)[:2]
        low, high = np.maximum(middle - half, -0.98 * near), np.minimum(middle + half, 0.98 * near)
        inner = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        outer = near * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        floor = Part(
            vertices=np.column_stack([inner, np.zeros(4)]),
            triangles=np.array([[0, 1, 2], [0, 2, 3]]),
            uv=inner / TILE_M,
            texture=noise.finish(painted),
            roughness=0.45 if self.floor == "planks" else 0.9,
            lightmap=True,
        )
        around = np.array([[k, (k + 1) % 4, 4 + (k + 1) % 4, k, 4 + (k + 1) % 4, 4 + k] for k in range(4)])
        rest = np.concatenate([outer, inner])
        return [
            floor,
            replace(
                floor,
                vertices=np.column_stack([rest, np.zeros(8)]),
                triangles=around.reshape(-1, 3),
                uv=rest / TILE_M,
                lightmap=False,
            ),
        ]


def _extent_m(bounds: Array) -> float:
    return float((bounds[1] - bounds[0])[:2].max())


def _planks(rng: np.random.Generator) -> Image:
    """Oak laminate: rows of boards with staggered joints and grain along the boards."""
    n = TILE_PX
    rows, boards = 12, 2
    color, image = np.array([176.0, 138.0, 98.0]), np.zeros((n, n, 3), dtype=np.float32)
    joint = np.zeros((n, n), dtype=np.float32)
    for row in range(rows):
        low, high = row * n // rows, (row + 1) * n // rows
        shift = int(rng.integers(n))
        for board in range(boards):
            w = n // boards
            grain = _grain((high - low, w), rng)
            tone = color * (1 + rng.normal(0, 0.07)) * (1 + np.array([0.0, 0.3, 0.8]) * rng.normal(0, 0.03))
            columns = (np.arange(w) + board * w + shift) % n
            image[low:high, columns] = noise.paint(tuple(tone), grain)
            joint[low:high, columns[:3]] = 1.0
        joint[low : low + 3] = 1.0
    joint = noise.blurred(joint, 0.8)
    image = noise.blend(image, image * 0.42, np.clip(1.2 * joint, 0, 1))
    return image * (1 + 0.02 * noise.fractal((n, n), 600, rng, octaves=3))[..., None]


def _grain(shape: tuple[int, int], rng: np.random.Generator) -> Image:
    """Flat-sawn wood grain: contour lines of anisotropic noise, with pores."""
    h = shape[0]
    bent = noise.tiling(shape, (60, 700), rng) * rng.uniform(1.5, 3.0) + 0.15 * noise.tiling(shape, (12, 250), rng)
    across = np.arange(h, dtype=np.float32)[:, None] / h * rng.uniform(3, 8)
    rings = np.sin(2 * np.pi * (across + 0.8 * bent))
    pores = np.clip(noise.tiling(shape, (1.6, 26), rng) - 1.2, 0, 2)
    fine = noise.tiling(shape, (1.5, 60), rng)
    return np.asarray(1 + 0.045 * rings + 0.035 * fine - 0.08 * pores, dtype=np.float32)


def _carpet(rng: np.random.Generator) -> Image:
    n = TILE_PX
    shade = 1 + 0.16 * noise.tiling((n, n), 3.0, rng) + 0.07 * noise.tiling((n, n), 9, rng)
    shade += 0.05 * noise.fractal((n, n), 500, rng, octaves=4)
    image = noise.paint((112, 116, 124), shade)
    threads = np.clip(noise.tiling((n, n), (3, 8), rng) - 1.4, 0, 1)
    return noise.blend(image, (150, 146, 138), 0.6 * threads)


def _concrete(rng: np.random.Generator) -> Image:
    n = TILE_PX
    shade = 1 + 0.05 * noise.fractal((n, n), 500, rng, octaves=8, gain=0.7) + 0.03 * noise.tiling((n, n), 2, rng)
    image = noise.paint((158, 156, 150), shade)
    stains = np.clip(noise.fractal((n, n), 260, rng, octaves=4) - 1.1, 0, 1)
    image = noise.blend(image, (110, 106, 98), 0.4 * stains)
    seam = np.zeros((n, n), dtype=np.float32)
    seam[: n // 256] = seam[:, : n // 256] = 1
    return noise.blend(image, (84, 82, 78), 0.8 * noise.blurred(seam, 1.0))


def _plaster(rng: np.random.Generator) -> Image:
    n = 512
    shade = 1 + 0.012 * noise.tiling((n, n), 4, rng) + 0.012 * noise.fractal((n, n), 200, rng, octaves=3)
    return noise.paint((214, 211, 202), shade)


@dataclass(frozen=True)
class Walls:
    """Walls and ceiling of a room, where furniture may stand along each wall, and the middle of the window, metres to
    the right of its wall's left corner.
    """

    parts: list[Part]
    free: list[Wall]
    window_m: float


def _walls(side: float, height: float, rng: np.random.Generator) -> Walls:
    """Four plastered walls with skirting boards, a door, a window and pictures."""
    plaster = noise.finish(_plaster(rng))
    half, parts, free, window_m = side / 2, list[Part](), list[Wall](), 0.0
    wood = np.full((8, 8, 3), 236, dtype=np.uint8)
    for k in range(4):
        turn = rotation_exp(np.array([0.0, 0.0, k * np.pi / 2]))
        vertices, triangles, uv = panel((-half, half, 0), (side, 0, 0), (0, 0, height), 0.5)
        shade = 0.80 + 0.2 * np.clip(vertices[:, 2:] / (0.5 * height), 0, 1)
        tint = np.column_stack([np.repeat(shade, 3, axis=1), np.full(len(vertices), 0.6)])
        parts.append(
            Part(vertices=vertices @ turn.T, triangles=triangles, uv=uv * [side, height], texture=plaster, tint=tint)
        )
        board = panel((-half, half - 0.004, 0), (side, 0, 0), (0, 0, SKIRTING_M), side)
        parts.append(Part(vertices=board[0] @ turn.T, triangles=board[1], texture=wood))
        things = (
            [_door(rng)] if k == DOOR_WALL else [_window(rng)] if k == WINDOW_WALL else [_picture(rng), _picture(rng)]
        )
        at = -half + side * (0.25 if len(things) == 2 else rng.uniform(0.3, 0.6))
        kept, lowest = [], np.inf
        for width, low, high, texture in things:
            corner = (at - width / 2, half - 0.02, min(low, height - 0.3))
            vertices, triangles, uv = panel(corner, (width, 0, 0), (0, 0, min(high, height - 0.1) - corner[2]), 9.0)
            glow = 2.4 if k == WINDOW_WALL else 0.95  # daylight behind the window
            tint = np.column_stack([np.full((len(vertices), 3), glow), np.full(len(vertices), 0.6)])
            parts.append(Part(vertices=vertices @ turn.T, triangles=triangles, uv=uv, texture=texture, tint=tint))
            if len(things) == 1:
                kept.append(Span(at + half - width / 2 - BESIDE_M, at + half + width / 2 + BESIDE_M))
            if k == WINDOW_WALL:
                window_m = at + half
            if k != DOOR_WALL:
                lowest = min(lowest, low)
            at += side * 0.4
        free.append(Wall(k, tuple(kept), lowest))
    ceiling = panel((-half, -half, height), (0, side, 0), (side, 0, 0), side)
    parts.append(Part(vertices=ceiling[0], triangles=ceiling[1], texture=wood))
    return Walls(parts, free, window_m)


Thing = tuple[float, float, float, np.ndarray]


def _door(rng: np.random.Generator) -> Thing:
    image = np.full((630, 300, 3), 206, dtype=np.uint8)
    cv2.rectangle(image, (0, 0), (299, 629), (168, 160, 150), 14)
    for low, high in ((60, 270), (330, 580)):
        cv2.rectangle(image, (60, low), (240, high), (176, 172, 166), 5)
        cv2.rectangle(image, (66, low + 6), (234, high - 6), (222, 220, 216), 2)
    cv2.circle(image, (262, 330), 9, (120, 112, 96), -1, cv2.LINE_AA)
    return 0.95, 0.0, 2.0, noise.finish(noise.blurred(image.astype(np.float32), 0.8))


def _window(rng: np.random.Generator) -> Thing:
    h, w = 360, 480
    glow = np.linspace(255, 190, h, dtype=np.float32)[:, None] * np.ones((1, w), dtype=np.float32)
    glow *= 1 + 0.03 * noise.fractal((h, w), 120, rng, octaves=4)
    image = noise.finish(noise.paint((0.93, 0.98, 1.0), glow))
    for x in (0, w // 2, w - 1):
        cv2.line(image, (x, 0), (x, h), (226, 224, 220), 22)
    for y in (0, h - 1):
        cv2.line(image, (0, y), (w, y), (226, 224, 220), 22)
    return 1.7, 0.9, 2.2, image


def _picture(rng: np.random.Generator) -> Thing:
    h, w = 240, 320
    tone, second = (rng.uniform(60, 210) + rng.normal(0, 22, 3) for _ in range(2))
    image = noise.paint(tuple(tone), 1 + 0.35 * noise.fractal((h, w), 140, rng, octaves=5))
    other = np.clip(noise.fractal((h, w), 160, rng, octaves=3) * 3, 0, 1)
    canvas = noise.finish(noise.blend(image, tuple(second), other))
    cv2.rectangle(canvas, (0, 0), (w - 1, h - 1), (54, 44, 38), 12)
    return float(rng.uniform(0.6, 1.0)), 1.2, 1.9, canvas
