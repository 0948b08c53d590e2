"""Trunk, limbs and boughs of a tree as swept, tapering tubes; the tree is 1 high and stands at the origin."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavbench.scenes.clutter.habits import FLARE, GOLDEN_RAD, STEEPER, TIP_TO_BASE, Detail, Habit
from uavbench.scenes.materials.painted import Material
from uavbench.scenes.renderables import Part
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Array

TRUNK_RINGS, LIMB_RINGS, BOUGH_RINGS = 7, 5, 2
"""Rings of vertices along a tube."""


@dataclass(frozen=True)
class Fineness:
    """Sides of the tubes of trunk, limbs and boughs; of the rings along trunk and limbs every `step`-th is there."""

    trunk: int
    limb: int
    bough: int
    step: int


FINE, COARSE = Fineness(8, 4, 3, 1), Fineness(6, 3, 3, 2)
"""Close to the structure, and farther away: the time of a frame goes with the number of triangles."""
EVENLY = 0.4
"""Radius at which as many limbs are added at all heights of a crown, over its largest, by eye: limbs are in proportion
to the crown's radius besides."""
UPPERMOST = 0.96
"""Highest start of a limb, as a fraction of the leader."""
SLENDER, AT_MOST = 0.028, 0.7
"""Radius of a limb at its base as a fraction of its length, and at most of the wood's on which it stands, by eye."""
PULLS = np.array([1.0, 0.8, 0.6, 0.4, 0.2])
"""Fractions of a bough's length that are tried, until it ends within the crown."""
INSIDE = 0.95
"""Radius within which limbs and boughs end, as a fraction of the crown's: leaves reach further."""


@dataclass(frozen=True)
class Crown:
    """Envelope of a crown: its largest radius, and the habit that has its outline."""

    radius: float
    habit: Habit

    def radii(self, heights: Array) -> Array:
        """Radii (n,) at heights (n,); 0 above and below the crown."""
        up = (heights - self.habit.crown_from) / (1 - self.habit.crown_from)
        rings = self.habit.outline
        wide = np.interp(up, [ring.up for ring in rings], [ring.wide for ring in rings], left=0.0, right=0.0)
        return self.radius * np.asarray(wide)

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Mask of points (..., 3) within INSIDE of the envelope."""
        return np.asarray(exact.hypot(points[..., 0], points[..., 1]) <= INSIDE * self.radii(points[..., 2]))


@dataclass(frozen=True, eq=False)
class Ends:
    """Points (n, 3) to which cards with leaves belong, and the unit directions (n, 3) of the wood there."""

    points: Array
    ways: Array


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Paths (n, rings, 3) of the trunk, limbs and boughs, and the radii (n, rings) of each."""

    trunk: Array
    trunk_radii: Array
    limbs: Array
    limb_radii: Array
    boughs: Array
    bough_radii: Array

    def ends(self) -> Ends:
        """Ends of limbs, boughs and the leader."""
        paths = [p for p in (self.trunk, self.limbs, self.boughs) if len(p)]
        points = np.concatenate([path[:, -1] for path in paths])
        ways = np.concatenate([path[:, -1] - path[:, -2] for path in paths])
        return Ends(points, ways / exact.length(ways)[:, None])

    def wood(self, bark: Material, height_m: float, fineness: Fineness) -> tuple[Part, ...]:
        """All tubes, with bark as large as on a tree of a height in metres."""
        step = fineness.step
        tubes = [
            swept(self.trunk[:, ::step], self.trunk_radii[:, ::step], fineness.trunk, bark, height_m),
            swept(self.limbs[:, ::step], self.limb_radii[:, ::step], fineness.limb, bark, height_m),
        ]
        if len(self.boughs):
            tubes.append(swept(self.boughs, self.bough_radii, fineness.bough, bark, height_m))
        return tuple(tubes)


def skeleton(crown: Crown, detail: Detail, rng: np.random.Generator) -> Skeleton:
    """The wood of a tree, drawn from rng: limbs end at the crown's envelope, boughs within it."""
    habit = crown.habit
    trunk = _trunk(habit, rng)
    trunk_radii = habit.trunk * np.linspace(1.0, 0.12, TRUNK_RINGS)
    trunk_radii[0] *= FLARE
    limbs = _limbs(crown, trunk, detail.limbs, rng)
    lengths = exact.length(limbs[:, -1] - limbs[:, 0])
    bases = np.minimum(SLENDER * lengths, AT_MOST * np.interp(limbs[:, 0, 2], trunk[:, 2], trunk_radii))
    limb_radii = bases[:, None] * np.linspace(1.0, TIP_TO_BASE, LIMB_RINGS)
    boughs, places = _boughs(crown, limbs, detail.boughs, rng)
    begin = AT_MOST * np.repeat(bases, detail.boughs) * (1 - (1 - TIP_TO_BASE) * places)
    bough_radii = begin[:, None] * np.linspace(1.0, TIP_TO_BASE, BOUGH_RINGS)
    return Skeleton(trunk[None], trunk_radii[None], limbs, limb_radii, boughs, bough_radii)


def _trunk(habit: Habit, rng: np.random.Generator) -> Array:
    """Path (TRUNK_RINGS, 3) of a trunk that leans and winds a little."""
    heights = np.concatenate([[0.0], np.linspace(0.03, habit.leader, TRUNK_RINGS - 1)])
    lean, wind = rng.normal(0, 0.02, 2), rng.normal(0, 0.008, (TRUNK_RINGS, 2))
    wind[:2] = 0.0
    stiff = 0.4 if habit.fronds else 1.0
    return np.column_stack([stiff * (heights[:, None] * lean + wind), heights])


def _limbs(crown: Crown, trunk: Array, count: int, rng: np.random.Generator) -> Array:
    """Paths (count, LIMB_RINGS, 3) from the trunk to the crown's envelope, more of them where the crown is wide."""
    habit = crown.habit
    heights = np.linspace(habit.crown_from, 1.0, 65)
    share = np.cumsum(crown.radii(heights) + EVENLY * crown.radius)
    share = (share - share[0]) / (share[-1] - share[0])
    ranks = (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count
    ends = np.interp(0.02 + 0.93 * ranks, share, heights)
    bearing = np.arange(count) * GOLDEN_RAD + rng.normal(0, 0.25, count) + rng.uniform(0, 2 * np.pi)
    outwards = INSIDE * crown.radii(ends) * rng.uniform(0.72, 1.0, count)
    tips = np.column_stack([outwards * exact.cos(bearing), outwards * exact.sin(bearing), ends])
    lowest = 0.75 * habit.crown_from if habit.rises > 0 else 0.5 * habit.crown_from
    up = (ends - habit.crown_from) / (1 - habit.crown_from)
    begins = np.clip(ends - (habit.rises + STEEPER * up**2) * outwards, lowest, UPPERMOST * habit.leader)
    axis = np.column_stack([np.interp(begins, trunk[:, 2], trunk[:, k]) for k in range(3)])
    middle = (axis + tips) / 2
    middle[:, 2] += habit.bows * exact.length(tips - axis)
    middle += rng.normal(0, 0.04, (count, 3)) * exact.length(tips - axis)[:, None]
    t = np.linspace(0, 1, LIMB_RINGS)[None, :, None]
    return (1 - t) ** 2 * axis[:, None] + 2 * t * (1 - t) * middle[:, None] + t**2 * tips[:, None]


def _boughs(crown: Crown, limbs: Array, each: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Paths (n, BOUGH_RINGS, 3) from limbs, around them in turn, and their places (n,) along their limbs."""
    n = len(limbs)
    if each == 0:
        return np.zeros((0, BOUGH_RINGS, 3)), np.zeros(0)
    places = (np.arange(each) + rng.uniform(0.2, 0.8, (n, each))) / each * 0.72 + 0.24
    at = places * (LIMB_RINGS - 1)
    segment = np.minimum(at.astype(np.int64), LIMB_RINGS - 2)
    rows = np.arange(n)[:, None]
    a, b = limbs[rows, segment], limbs[rows, segment + 1]
    starts = (a + (at - segment)[..., None] * (b - a)).reshape(-1, 3)
    along = (b - a).reshape(-1, 3)
    along /= exact.length(along)[:, None]
    side = np.cross(along, [0.0, 0.0, 1.0])
    side /= np.maximum(exact.length(side), 1e-9)[:, None]
    over = np.cross(side, along)
    roll = (np.arange(each) * GOLDEN_RAD + rng.uniform(0, 2 * np.pi, (n, 1)) + rng.normal(0, 0.3, (n, each))).reshape(
        -1
    )
    ways = 0.6 * along + exact.cos(roll)[:, None] * side + exact.sin(roll)[:, None] * over + [0.0, 0.0, 0.15]
    ways *= (crown.habit.bough * rng.uniform(0.6, 1.2, len(ways)) / exact.length(ways))[:, None]
    inside = crown.holds(starts[:, None] + PULLS[:, None] * ways[:, None])
    pull = np.where(inside.any(axis=1), PULLS[inside.argmax(axis=1)], 0.15)
    ends = starts + pull[:, None] * ways
    return np.stack([starts, ends], axis=1), places.reshape(-1)


def swept(paths: Array, radii: Array, sides: int, bark: Material, height_m: float) -> Part:
    """Open tubes of radii (n, k) along paths (n, k, 3), smooth, with bark as large as on a tree of height_m."""
    n, k = radii.shape
    along = np.gradient(paths, axis=1)
    along /= exact.length(along)[..., None]
    chord = paths[:, -1] - paths[:, 0]
    aside = np.where(np.abs(chord[:, 2:]) > 0.8 * exact.length(chord)[:, None], [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    u = np.cross(along, np.broadcast_to(aside[:, None], along.shape))
    u /= exact.length(u)[..., None]
    v = np.cross(along, u)
    angle = np.arange(sides + 1) * 2 * np.pi / sides
    around = exact.cos(angle)[:, None] * u[:, :, None] + exact.sin(angle)[:, None] * v[:, :, None]
    vertices = paths[:, :, None] + radii[..., None, None] * around
    way = np.cumsum(exact.length(np.diff(paths, axis=1, prepend=paths[:, :1])), axis=1) * height_m
    girth = 2 * np.pi * height_m * radii.max(axis=1)
    turn = np.arange(sides + 1) / sides
    uv = np.stack(np.broadcast_arrays(girth[:, None, None] * turn, way[..., None]), axis=-1) / np.array(bark.tile_m)
    tube = np.arange(n)[:, None, None] * k * (sides + 1)
    corner = (tube + np.arange(k - 1)[:, None] * (sides + 1) + np.arange(sides)).reshape(-1)
    beyond = corner + sides + 1
    return Part(
        vertices=vertices.reshape(-1, 3),
        triangles=np.concatenate(
            [np.column_stack([corner, corner + 1, beyond + 1]), np.column_stack([corner, beyond + 1, beyond])]
        ),
        normals=around.reshape(-1, 3),
        uv=uv.reshape(-1, 2),
        texture=bark.texture,
        roughness=bark.roughness,
    )
