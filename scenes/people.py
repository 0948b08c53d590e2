"""Clutter of the size of people: figures that stand, and figures that walk to and fro."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Interval

from scenes import materials
from scenes.materials import Material
from scenes.meshes import merge
from scenes.parts import BuiltClutter, Mover, Part
from scenes.placing import ring_places
from scenes.solids import moved
from trajectories.pose import Array, Pose, rotation_exp

INSTANCE = 3
BODY = np.array(
    [[0.00, 0.12], [0.06, 0.10], [0.45, 0.10], [0.85, 0.155], [1.05, 0.15], [1.30, 0.175], [1.42, 0.16], [1.48, 0.07],
     [1.54, 0.065], [1.58, 0.09], [1.66, 0.105], [1.74, 0.09], [1.78, 0.02]]
)  # fmt: skip
"""Height and radius (m) along a standing figure of 1.78 m, arms to its sides."""
TROUSERS = ((0.03, 0.04, 0.09), (0.05, 0.05, 0.05), (0.20, 0.16, 0.10))
SHIRTS = ((0.03, 0.05, 0.14), (0.30, 0.04, 0.03), (0.70, 0.28, 0.03), (0.07, 0.09, 0.07), (0.55, 0.55, 0.52))
SKIN, HAIR = ((0.50, 0.30, 0.21), (0.12, 0.06, 0.04)), ((0.02, 0.015, 0.01), (0.16, 0.10, 0.05))
"""Linear colours."""


@dataclass(frozen=True)
class People:
    """Figures around the structure, as many as density times ten; the share `walking` of them walks along a line."""

    density: Annotated[float, Interval(ge=0, le=20)] = 0.5
    walking: Annotated[float, Interval(ge=0, le=1)] = 0.5
    nearest_m: Annotated[float, Gt(0)] = 1.0
    furthest_m: Annotated[float, Gt(0)] = 8.0
    speed_m_s: Annotated[float, Ge(0)] = 1.2

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltClutter:
        """Those who stand as one mesh, those who walk each as a mover."""
        places = ring_places(bounds, round(10 * self.density), self.nearest_m, self.furthest_m, rng)
        wear = materials.cloth(rng, (225.0, 225.0, 225.0))
        standing: list[Part] = []
        movers = []
        for place in places:
            figure = _figure(float(rng.uniform(0.9, 1.06)), wear, rng)
            bearing = float(rng.uniform(0, 2 * np.pi))
            if rng.random() < self.walking:
                outward = place - bounds.mean(axis=0)
                bearing = float(np.arctan2(outward[1], outward[0]) + np.pi / 2)
                movers.append(
                    Mover(
                        figure, Walk(place, bearing, self.speed_m_s, float(rng.uniform(2, 6)), float(rng.uniform(0, 9)))
                    )
                )
            else:
                standing.append(moved(figure, rotation_exp(np.array([0, 0, bearing])), place))
        return BuiltClutter((merge(standing),) if standing else (), tuple(movers))


@dataclass(frozen=True, eq=False)
class Walk:
    """To and fro over length_m along a bearing, at one speed."""

    place: Array
    bearing_rad: float
    speed_m_s: float
    length_m: float
    start_s: float

    def __call__(self, time_s: float) -> Pose:
        """world_from_part at a time."""
        way = (time_s + self.start_s) * self.speed_m_s
        phase = way % (2 * self.length_m)
        back = phase > self.length_m
        along = (2 * self.length_m - phase if back else phase) - self.length_m / 2
        turn = self.bearing_rad + (np.pi if back else 0.0)
        step = 0.03 * abs(np.sin(np.pi * way / 0.75))
        ahead = np.array([np.cos(self.bearing_rad), np.sin(self.bearing_rad), 0.0])
        return Pose(rotation_exp(np.array([0.0, 0.0, turn])), self.place + along * ahead + np.array([0.0, 0.0, step]))


def _figure(scale: float, wear: Material, rng: np.random.Generator) -> Part:
    """A turned figure, flattened from front to back, dressed."""
    sides = 10
    angle = np.arange(sides) * 2 * np.pi / sides
    around = np.column_stack([0.62 * np.cos(angle), np.sin(angle)])
    vertices = np.concatenate([np.column_stack([r * around * 1.25, np.full(sides, z)]) for z, r in BODY]) * scale
    rings = len(BODY)
    i = np.arange(sides)
    j = (i + 1) % sides
    triangles = []
    for k in range(rings - 1):
        a, b = k * sides, (k + 1) * sides
        triangles += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    normals = np.concatenate([np.column_stack([around, np.zeros(sides)])] * rings)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tint = np.ones((len(vertices), 4))
    height = np.repeat(BODY[:, 0], sides)
    bands = ((0.0, TROUSERS), (0.9, SHIRTS), (1.47, SKIN), (1.70, HAIR))
    for low, colors in bands:
        tint[height > low - 0.01, :3] = colors[int(rng.integers(len(colors)))]
    return Part(
        vertices=vertices,
        triangles=np.concatenate(triangles),
        normals=normals,
        uv=np.column_stack([np.tile(angle / 6.3, rings), np.repeat(BODY[:, 0], sides)]),
        texture=wear.texture,
        tint=tint,
        roughness=1.0,
        instance=INSTANCE,
    )
