"""Trees that branch: wood and leaves of a habit, as tall and as wide as their places ask."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.clutter import foliage
from uavbench.scenes.clutter.habits import FAR_M, HABITS, TREE_SPREAD, HabitName
from uavbench.scenes.clutter.limbs import COARSE, FINE, Crown, skeleton
from uavbench.scenes.materials import painted as materials
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.primitives.meshes import merged
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Array

INSTANCE = 2
"""Value of trees in the instance mask."""
WIDTH_SPREAD = (0.88, 1.0)
"""Range of the widths of crowns over their habit's, by eye."""


@dataclass(frozen=True, eq=False)
class Place:
    """Where a tree stands (3,), in metres in the world, and its distance from the structure's bounds, metres."""

    at: Array
    gap_m: float


@dataclass(frozen=True, eq=False)
class Looks:
    """Bark and sprays that the trees of a scene share: sprays by the names of habits."""

    bark: Material
    white_bark: Material
    sprays: dict[str, Texture]

    @classmethod
    def of(cls, asked: Sequence[str], bark: Material, rng: np.random.Generator) -> "Looks":
        """Looks that the habits of these names need; each spray has a random stream of its own."""
        for_bark, *for_sprays = rng.spawn(1 + len(HABITS))
        streams = dict(zip(HABITS, for_sprays, strict=True))
        white = materials.birch_bark(for_bark) if any(HABITS[name].white_bark for name in asked) else bark
        return cls(bark, white, {name: foliage.spray(HABITS[name].leaf, streams[name]) for name in asked})


def branching_trees(
    habit: HabitName, height_m: float, places: Sequence[Place], bark: Material, rng: np.random.Generator
) -> tuple[Part, ...]:
    """Trees of a habit, or each of one of HABITS if it is `mixed`, of TREE_SPREAD times a height in metres.

    Each tree has a random stream of its own, and a crown that ends short of the structure's bounds.
    """
    asked = tuple(HABITS) if habit == "mixed" else (habit,)
    for_looks, for_trees = rng.spawn(2)
    looks = Looks.of(asked, bark, for_looks)
    trees: list[Part] = []
    for place, own in zip(places, for_trees.spawn(len(places)), strict=True):
        name = asked[int(own.integers(len(asked)))]
        trees += branching_tree(name, height_m * float(own.uniform(*TREE_SPREAD)), place, looks, own)
    return merged(trees)


def branching_tree(
    name: str, height_m: float, place: Place, looks: Looks, rng: np.random.Generator
) -> tuple[Part, ...]:
    """A tree of the habit of a name and a height in metres: its wood, then its leaves."""
    habit = HABITS[name]
    near = place.gap_m < FAR_M
    detail, large, fineness = (habit.near, 1.0, FINE) if near else (habit.far, habit.far_card, COARSE)
    radius = habit.crown_wide / 2 * float(rng.uniform(*WIDTH_SPREAD))
    crown = Crown(min(radius, place.gap_m / height_m), habit)
    bones = skeleton(crown, detail, rng)
    if habit.fronds:
        cards = foliage.fronds(bones, large, rng)
    else:
        cards = foliage.clusters(bones.ends(), habit, detail.cards, large, rng)
    leaves = foliage.leaves(cards, crown, looks.sprays[name], rng)
    wood = bones.wood(looks.white_bark if habit.white_bark else looks.bark, height_m, fineness)
    reach = float(exact.hypot(leaves.vertices[:, 0], leaves.vertices[:, 1]).max())
    within = min(1.0, crown.radius / reach)
    size = height_m * np.array([within, within, 1 / float(leaves.vertices[:, 2].max())])
    return tuple(replace(part, vertices=part.vertices * size + place.at, instance=INSTANCE) for part in (*wood, leaves))
