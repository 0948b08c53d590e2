"""Human-sized clutter: standing figures, and figures walking back and forth."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Interval

from uavbench.scenes.clutter.placing import Free, anywhere, check_reach, ring_places
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.meshes import merge
from uavbench.scenes.primitives.solids import moved
from uavbench.scenes.renderables import BuiltClutter, Mover, Part
from uavbench.trajectories.errors import refuse_idle
from uavbench.trajectories.pose import Array, Pose, rotation_exp

INSTANCE = 3
Color = tuple[float, float, float]
LIMBS: dict[str, tuple[Array, tuple[float, float], float]] = {
    "leg": (np.array([[0.0, 0.05], [0.04, 0.075], [0.09, 0.055], [0.45, 0.065], [0.86, 0.095]]), (0.0, 0.09), 1.0),
    "trunk": (np.array([[0.80, 0.14], [0.95, 0.165], [1.15, 0.16], [1.35, 0.19], [1.45, 0.15], [1.49, 0.06]]),
              (0.0, 0.0), 0.62),
    "arm": (np.array([[0.72, 0.02], [0.76, 0.045], [0.85, 0.035], [1.12, 0.047], [1.40, 0.06], [1.45, 0.03]]),
            (0.0, 0.205), 1.0),
    "head": (np.array([[1.44, 0.055], [1.52, 0.055], [1.57, 0.078], [1.64, 0.095], [1.72, 0.085], [1.78, 0.02]]),
             (0.015, 0.0), 1.1),
}  # fmt: skip
"""Limbs of a figure of 1.78 m: profile (height, radius) and offset (forwards, sideways) in m; depth-to-width ratio."""
SIDES = 10
TROUSERS = ((0.03, 0.04, 0.09), (0.05, 0.05, 0.05), (0.20, 0.16, 0.10))
SHIRTS = ((0.03, 0.05, 0.14), (0.30, 0.04, 0.03), (0.70, 0.28, 0.03), (0.07, 0.09, 0.07), (0.55, 0.55, 0.52))
SKIN, HAIR = ((0.50, 0.30, 0.21), (0.12, 0.06, 0.04)), ((0.02, 0.015, 0.01), (0.16, 0.10, 0.05))
"""Linear RGB albedo of clothes, skin and hair."""


@dataclass(frozen=True)
class People:
    """Human figures around the structure, 10 times density in number; the fraction `walking` of them walks.

    UserError unless nearest_m is below furthest_m.
    """

    density: Annotated[float, Interval(ge=0, le=20)] = 0.5
    walking: Annotated[float, Interval(ge=0, le=1)] = 0.5
    nearest_m: Annotated[float, Gt(0)] = 1.0
    furthest_m: Annotated[float, Gt(0)] = 8.0
    speed_m_s: Annotated[float, Ge(0)] = 1.2

    def __post_init__(self) -> None:
        check_reach(self.nearest_m, self.furthest_m)
        refuse_idle(self, {"speed_m_s": ("walking",)})

    def build(self, bounds: Array, rng: np.random.Generator, free: Free = anywhere) -> BuiltClutter:
        """The standing figures as one mesh, and a mover for each walking one; bounds (2, 3) in metres, world frame.

        They stand on free ground, nearest_m to furthest_m outside the bounds.
        """
        places = self._places(bounds, rng, free)
        wear = materials.cloth(rng, (225.0, 225.0, 225.0))
        standing: list[Part] = []
        movers = []
        for place in places:
            figure = _figure(float(rng.uniform(0.9, 1.06)), wear, rng)
            bearing = float(rng.uniform(0, 2 * np.pi))
            if rng.random() < self.walking:
                walk = Walk(
                    bounds.mean(axis=0) * [1, 1, 0],
                    place - bounds.mean(axis=0) * [1, 1, 0],
                    self.speed_m_s,
                    float(rng.uniform(2, 6)),
                    float(rng.uniform(0, 9)),
                )
                movers.append(Mover(figure, walk))
            else:
                standing.append(moved(figure, rotation_exp(np.array([0, 0, bearing])), place))
        return BuiltClutter((merge(standing),) if standing else (), tuple(movers))

    def check_room(self, bounds: Array, rng: np.random.Generator, free: Free = anywhere) -> None:
        """UserError as of `build` when there is no room for all figures, without shaping them."""
        self._places(bounds, rng, free)

    def _places(self, bounds: Array, rng: np.random.Generator, free: Free) -> Array:
        reach_m = self.nearest_m, self.furthest_m
        return ring_places(bounds, round(10 * self.density), reach_m, rng, free)


@dataclass(frozen=True, eq=False)
class Walk:
    """Walk back and forth at constant speed along an arc about a centre.

    centre and offset (3,) in the world frame, metres: the middle of the arc is centre + offset; length_m is the length
    of the arc; start_s shifts the phase.
    """

    centre: Array
    offset: Array
    speed_m_s: float
    length_m: float
    start_s: float

    def __call__(self, time_s: float) -> Pose:
        """Pose `world_from_part` at a time in seconds; the figure's x axis points forwards."""
        way = (time_s + self.start_s) * self.speed_m_s
        phase = way % (2 * self.length_m)
        back = phase > self.length_m
        along = (2 * self.length_m - phase if back else phase) - self.length_m / 2
        turned = rotation_exp(np.array([0.0, 0.0, along / float(np.linalg.norm(self.offset))]))
        place = self.centre + turned @ self.offset
        outward = turned @ self.offset
        heading = float(np.arctan2(outward[1], outward[0])) + (-np.pi / 2 if back else np.pi / 2)
        step = 0.03 * abs(np.sin(np.pi * way / 0.75))
        return Pose(rotation_exp(np.array([0.0, 0.0, heading])), place + np.array([0.0, 0.0, step]))


def _figure(scale: float, wear: Material, rng: np.random.Generator) -> Part:
    """A clothed figure of legs, trunk, arms and head, each an elliptical surface of revolution."""
    trousers, shirt, skin, hair = (colors[int(rng.integers(len(colors)))] for colors in (TROUSERS, SHIRTS, SKIN, HAIR))
    bands = {
        "leg": ((0.0, (0.02, 0.02, 0.02)), (0.08, trousers)),
        "trunk": ((0.0, trousers), (0.94, shirt)),
        "arm": ((0.0, skin), (0.84, shirt)),
        "head": ((0.0, skin), (1.70, hair)),
    }
    limbs = [
        _limb(name, side, bands[name], wear) for name in LIMBS for side in ((1, -1) if LIMBS[name][1][1] else (1,))
    ]
    figure = merge(limbs)
    return replace(figure, vertices=figure.vertices * scale)


def _limb(name: str, side: int, bands: tuple[tuple[float, Color], ...], wear: Material) -> Part:
    """A limb as an elliptical surface of revolution about a vertical axis; bands are (lowest height, linear RGB)."""
    profile, (ahead, aside), depth = LIMBS[name]
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    around = np.column_stack([depth * np.cos(angle), np.sin(angle)])
    slope = np.gradient(profile[:, 1], profile[:, 0])
    vertices = np.concatenate([np.column_stack([r * around, np.full(SIDES, z)]) for z, r in profile])
    normals = np.concatenate([np.column_stack([around / [depth**2, 1], np.full(SIDES, -k)]) for k in slope])
    i = np.arange(SIDES)
    j = (i + 1) % SIDES
    rings = [(k * SIDES, (k + 1) * SIDES) for k in range(len(profile) - 1)]
    quads = [pair for a, b in rings for pair in ((a + i, a + j, b + j), (a + i, b + j, b + i))]
    tint = np.ones((len(vertices), 4))
    height = np.repeat(profile[:, 0], SIDES)
    for low, color in bands:
        tint[height >= low, :3] = color
    return Part(
        vertices=vertices + np.array([ahead, side * aside, 0.0]),
        triangles=np.concatenate([np.column_stack(quad) for quad in quads]),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        uv=np.column_stack([np.tile(angle / 6.3, len(profile)), height]),
        texture=wear.texture,
        tint=tint,
        roughness=1.0,
        instance=INSTANCE,
    )
