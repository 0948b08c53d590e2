"""Trees as clutter: each a trunk with branches and a crown of alpha-tested leaf cards."""

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.clutter.branching import INSTANCE, Place, branching_trees
from uavbench.scenes.clutter.habits import HabitName
from uavbench.scenes.clutter.placing import Free, anywhere, check_reach, gap_m, ring_places
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.primitives.meshes import merge
from uavbench.scenes.primitives.solids import circle, covered, moved, prism
from uavbench.scenes.renderables import BuiltClutter, Part, Texture
from uavbench.trajectories.errors import refuse_other
from uavbench.trajectories.pose import Array, rotation_exp

CARDS = 70


@dataclass(frozen=True)
class Trees:
    """Trees around the structure, 20 times density in number, at least nearest_m from its bounds.

    habit is the form of their crowns: `round` is a ball of leaves, the others branch, and `mixed` mixes these.
    UserError unless nearest_m is below furthest_m.
    """

    density: Annotated[float, Interval(ge=0, le=20)] = 0.5
    height_m: Annotated[float, Gt(0.1), Interval(le=60)] = 6.0
    nearest_m: Annotated[float, Gt(0)] = 3.0
    furthest_m: Annotated[float, Gt(0)] = 30.0
    habit: HabitName = "round"

    def __post_init__(self) -> None:
        check_reach(self.nearest_m, self.furthest_m)

    def build(self, bounds: Array, rng: np.random.Generator, free: Free = anywhere) -> BuiltClutter:
        """All trees as meshes of wood and leaves, on free ground around a structure of bounds (2, 3) in metres.

        They stand in the same places whatever their habit. UserError for a habit that there is not.
        """
        refuse_other("habit", self.habit, HabitName)
        count = round(20 * self.density)
        if count == 0:
            return BuiltClutter()
        bark, leaves = materials.bark(rng), _leaves(rng)
        places = self._places(bounds, count, rng, free)
        if self.habit != "round":
            stands = [Place(place, gap_m(bounds, place)) for place in places]
            return BuiltClutter(branching_trees(self.habit, self.height_m, stands, bark, rng))
        wood: list[Part] = []
        crowns: list[Part] = []
        for place in places:
            height = self.height_m * float(rng.uniform(0.65, 1.35))
            trunk, crown = _tree(height, bark, leaves, rng)
            turn = rotation_exp(np.array([0.0, 0.0, rng.uniform(0, 6.3)]))
            wood += [moved(part, turn, place) for part in trunk]
            crowns.append(moved(crown, turn, place))
        return BuiltClutter((merge(wood), merge(crowns)))

    def check_room(self, bounds: Array, rng: np.random.Generator, free: Free = anywhere) -> None:
        """UserError as of `build` when there is no room for all trees, without growing them."""
        count = round(20 * self.density)
        if count:
            materials.bark(rng), _leaves(rng)
            self._places(bounds, count, rng, free)

    def _places(self, bounds: Array, count: int, rng: np.random.Generator, free: Free) -> Array:
        return ring_places(bounds, count, (self.nearest_m, self.furthest_m), rng, free)


def _tree(
    height: float, bark: materials.Material, leaves: Texture, rng: np.random.Generator
) -> tuple[list[Part], Part]:
    radius = 0.022 * height
    lean = rng.normal(0, 0.02, 2) * height
    fork = np.array([*lean, 0.42 * height])
    trunk = [prism(circle(radius, 6), (0, 0, 0), fork, bark)]
    middle = np.array([*(1.4 * lean), 0.66 * height])
    for _ in range(4):
        tip = middle + rng.normal(0, 1, 3) * [0.16, 0.16, 0.10] * height
        trunk.append(prism(circle(0.4 * radius, 5), fork, tip, bark))
    size = np.array([0.24, 0.24, 0.30]) * height * rng.uniform(0.85, 1.15, 3)
    direction = rng.standard_normal((CARDS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    centres = middle + direction * size * rng.uniform(0.55, 1.0, (CARDS, 1))
    side = rng.uniform(0.11, 0.17, (CARDS, 1)) * height
    u = np.cross(direction, rng.standard_normal((CARDS, 3)))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(direction + 0.5 * rng.standard_normal((CARDS, 3)), u)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    corners = np.stack(
        [centres - side * (u + v), centres + side * (u - v), centres + side * (u + v), centres - side * (u - v)], 1
    )
    first = 4 * np.arange(CARDS)[:, None]
    depth = 0.55 + 0.45 * np.linalg.norm((centres - middle) / size, axis=1) * (0.75 + 0.25 * direction[:, 2])
    tone = np.repeat(depth[:, None] * rng.uniform(0.8, 1.15, (CARDS, 1)), 4, axis=0)
    crown = Part(
        vertices=corners.reshape(-1, 3),
        triangles=np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])]),
        normals=np.repeat(direction, 4, axis=0),
        uv=np.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (CARDS, 1)),
        texture=leaves,
        tint=np.column_stack([tone, tone, tone, np.ones(4 * CARDS)]),
        roughness=1.0,
        two_sided=True,
        instance=INSTANCE,
    )
    return [covered(solid, INSTANCE, longest_m=100.0) for solid in trunk], crown


def _leaves(rng: np.random.Generator) -> Texture:
    """RGBA texture of the leaves of a twig."""
    n = 256
    image = np.zeros((n, n, 4), dtype=np.uint8)
    image[..., :3] = (74, 92, 44)
    for _ in range(230):
        angle = rng.uniform(0, 360)
        at = rng.normal(n / 2, n / 5.2, 2).clip(14, n - 14)
        tone = rng.uniform(0.65, 1.25) * np.array([86.0, 108.0, 50.0]) + rng.normal(0, 5, 3)
        color = (*(int(c) for c in tone.clip(0, 255)), 255)
        long = float(rng.uniform(7, 13))
        cv2.ellipse(
            image, (int(at[0]), int(at[1])), (int(long), int(0.45 * long)), angle, 0, 360, color, -1, cv2.LINE_8
        )
    grain = 1 + 0.08 * noise.tiling((n, n), 3, rng)
    image[..., :3] = noise.finish(image[..., :3].astype(np.float32) * grain[..., None])
    return image
