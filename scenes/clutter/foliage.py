"""Leaves of a tree as alpha-tested cards on its wood, and the sprays of leaves that the cards show."""

from dataclasses import dataclass

import cv2
import numpy as np

from uavbench.scenes.clutter.habits import Habit, Leaf
from uavbench.scenes.clutter.limbs import Crown, Ends, Skeleton
from uavbench.scenes.materials import procedural_texture as noise
from uavbench.scenes.renderables import Part, Texture
from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.pose import Array

SPRAY_PX = 256
"""Side of the texture of a spray: texels of 5 mm on a card of 1.3 m, as fine as the pixels of a camera of 400 px focal
length 2 m away."""
BACK = 0.42
"""Part of a card that lies behind the end of its bough, so that the end is among leaves."""
ROUNDED, LIFTED = 0.55, 0.20
"""Share of a card's own roundness in its normals, beside the crown's, and of the upward direction: by eye."""
INNER, TONE, HUE = 0.42, 0.13, 0.05
"""Light that reaches the inside of a crown over that at its outside; half the range of the relative brightness of
cards; standard deviation of the redness of trees. By eye."""
FROND_ROLLS = (-0.55, 0.55, np.pi / 2)
"""Angles of the cards of a limb with fronds about it, rad: two like a roof, and one that hangs."""
FROND_WIDE, BEYOND_TIP, TOP_FROND = 0.62, 1.06, 0.07
"""Width of a frond over its length, that over its limb's, and the length of the uppermost one below the leader's end,
by eye."""
WOOD = (78, 62, 44, 255)
"""Colour of twigs, sRGB and opaque."""
SIDE_TWIGS, FROND_TWIGS, NEEDLE_STEP = 16, 34, 0.016
"""Twigs beside the middle one of a spray of leaves; pairs of twigs of a frond, and the distance between needles on them
in the image's side. By eye: they cover about 0.4 of the image."""
BLADE = np.array(
    [[0.0, 0.0], [0.15, 0.32], [0.4, 0.5], [0.7, 0.34], [1.0, 0.0], [0.7, -0.34], [0.4, -0.5], [0.15, -0.32]]
)
"""Outline of a leaf: along its length, and across in its width."""
BOTH_SIDES = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]])
"""Triangles of a card, front and back: with one normal, both sides are lit as the crown is there."""


@dataclass(frozen=True, eq=False)
class Cards:
    """Rectangles (n): the middle of the lower side, half of that side, and the other side, each (n, 3)."""

    foot: Array
    half: Array
    rise: Array

    def corners(self) -> Array:
        """Corners (n, 4, 3), the lower ones first, counter-clockwise."""
        low, high = self.foot, self.foot + self.rise
        return np.stack([low - self.half, low + self.half, high + self.half, high - self.half], axis=1)


def clusters(ends: Ends, habit: Habit, each: int, large: float, rng: np.random.Generator) -> Cards:
    """Crossed cards, `each` at every end, `large` times the habit's size."""
    n = each * len(ends.points)
    points, ways = np.repeat(ends.points, each, axis=0), np.repeat(ends.ways, each, axis=0)
    up = (1 - habit.hangs) * (ways + 0.75 * _directions(n, rng)) - habit.hangs * np.array([0.0, 0.0, 1.0])
    up /= exact.length(up)[:, None]
    across = np.cross(up, _directions(n, rng))
    across /= exact.length(across)[:, None]
    side = large * habit.card * rng.uniform(0.8, 1.2, n)[:, None]
    return Cards(points - BACK * side * up, 0.5 * side * across, side * up)


def fronds(skeleton: Skeleton, large: float, rng: np.random.Generator) -> Cards:
    """Cards along limbs and around the leader's end, `large` times as wide as FROND_WIDE."""
    rolls = len(FROND_ROLLS)
    top = skeleton.trunk[0, -1]
    tops = np.array([[0.0, 0.0, -TOP_FROND], [0.0, 0.0, 0.2 * TOP_FROND]]) + top
    foot = np.concatenate([np.repeat(skeleton.limbs[:, 0], rolls, axis=0), np.repeat(tops[:1], rolls, axis=0)])
    tip = np.concatenate([np.repeat(skeleton.limbs[:, -1], rolls, axis=0), np.repeat(tops[1:], rolls, axis=0)])
    along = BEYOND_TIP * (tip - foot)
    long = exact.length(along)[:, None]
    side = np.cross(along / long, [0.0, 0.0, 1.0])
    side[-rolls:] = [1.0, 0.0, 0.0]
    side /= exact.length(side)[:, None]
    over = np.cross(side, along / long)
    roll = np.concatenate([np.tile(FROND_ROLLS, len(skeleton.limbs)), np.arange(rolls) * np.pi / rolls])
    roll = roll + rng.normal(0, 0.15, len(roll))
    across = exact.cos(roll)[:, None] * side + exact.sin(roll)[:, None] * over
    wide = large * FROND_WIDE * np.maximum(long, 0.6 * long.mean()) * rng.uniform(0.85, 1.15, (len(long), 1))
    wide[-rolls:] *= 0.6
    return Cards(foot, 0.5 * wide * across, along)


def leaves(cards: Cards, crown: Crown, texture: Texture, rng: np.random.Generator) -> Part:
    """Cards as a part, shaded as the volume of the crown: normals point outwards, and the inside is darker."""
    corners, n = cards.corners(), len(cards.foot)
    corners[..., 2] = np.maximum(corners[..., 2], 0.0)
    low = crown.habit.crown_from
    half = (1 - low) / 2
    reach = np.array([crown.radius, crown.radius, half])
    from_middle = (corners - [0.0, 0.0, low + 0.85 * half]) / reach
    outwards = from_middle / reach
    outwards /= np.maximum(exact.length(outwards), 1e-9)[..., None]
    own = corners - corners.mean(axis=1, keepdims=True)
    own /= exact.length(own)[..., None]
    normals = (1 - ROUNDED) * outwards + ROUNDED * own + [0.0, 0.0, LIFTED]
    normals /= exact.length(normals)[..., None]
    heights = corners[..., 2]
    wide = np.maximum(crown.radii(heights.reshape(-1)).reshape(heights.shape), 0.15 * crown.radius)
    depth = np.clip(exact.hypot(corners[..., 0], corners[..., 1]) / wide, 0, 1)
    depth = np.clip(np.maximum(depth, from_middle[..., 2]), 0, 1)
    tone = (INNER + (1 - INNER) * depth) * (0.80 + 0.20 * normals[..., 2]) * rng.uniform(1 - TONE, 1 + TONE, (n, 1))
    red = 1 + HUE * float(np.clip(rng.standard_normal(), -2, 2))
    tint = np.stack([red * tone, tone, tone, np.ones_like(tone)], axis=-1)
    first = 4 * np.arange(n)[:, None]
    return Part(
        vertices=corners.reshape(-1, 3),
        triangles=np.concatenate([first + triangle for triangle in BOTH_SIDES]),
        normals=normals.reshape(-1, 3),
        uv=np.tile([[0.01, 0.01], [0.99, 0.01], [0.99, 0.99], [0.01, 0.99]], (n, 1)),
        texture=texture,
        tint=tint.reshape(-1, 4),
        roughness=1.0,
        keeps_cover=True,
    )


def spray(leaf: Leaf, rng: np.random.Generator) -> Texture:
    """RGBA texture of a twig that rises from the middle of the lower side, with side twigs and leaves or needles."""
    n = SPRAY_PX
    image = np.zeros((n, n, 4), dtype=np.uint8)
    image[..., :3] = np.array(leaf.color, dtype=np.uint8)
    (_frond if leaf.needles else _leafy)(image, leaf, rng)
    grain = 1 + 0.06 * noise.tiling((n, n), 3, rng)
    image[..., :3] = noise.finish(image[..., :3].astype(np.float32) * grain[..., None])
    return image


@dataclass(frozen=True, eq=False)
class Twig:
    """A straight twig in a spray: its foot (2,), direction, rad from the right, and length, in the image's side."""

    foot: Array
    way: float
    long: float

    def at(self, along: float) -> Array:
        """Place (2,) at a distance from the foot."""
        return self.foot + along * np.array([exact.cos(self.way), exact.sin(self.way)])


def _leafy(image: Texture, leaf: Leaf, rng: np.random.Generator) -> None:
    """Draw leaves on the twigs of a broadleaved tree, in a roundish outline."""
    n = len(image)
    twigs = [Twig(np.array([0.5, 0.0]), np.pi / 2, 0.86)]
    for k in range(SIDE_TWIGS):
        up = 0.03 + 0.83 * k / SIDE_TWIGS
        turn = (1 if k % 2 else -1) * float(rng.uniform(0.55, 1.15))
        long = 0.48 * (1 - (1.6 * up - 0.5) ** 2) * float(rng.uniform(0.75, 1.0))
        twigs.append(Twig(np.array([0.5, up]), np.pi / 2 + turn, long))
    for twig in twigs:
        ends = np.rint(np.array([twig.foot, twig.at(twig.long)]) * [n, -n] + [0, n]).astype(np.int32)
        cv2.polylines(image, [ends], False, WOOD, 3 if twig is twigs[0] else 2, cv2.LINE_8)
    lengths = np.array([twig.long for twig in twigs])
    for k in rng.choice(len(twigs), leaf.count, p=lengths / lengths.sum()).tolist():
        place = twigs[k].at(twigs[k].long * float(rng.uniform(0.01, 1) ** 0.7))
        way = twigs[k].way + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.3))
        size = leaf.long * float(rng.uniform(0.7, 1.15))
        _blade(image, Twig(place, way, size), leaf.wide * size * float(rng.uniform(0.55, 1.0)), _toned(leaf, rng))


def _blade(image: Texture, middle: Twig, wide: float, color: tuple[int, ...]) -> None:
    """Fill a pointed leaf about its middle rib."""
    ahead = np.array([exact.cos(middle.way), exact.sin(middle.way)])
    outline = middle.foot + middle.long * BLADE[:, :1] * ahead + wide * BLADE[:, 1:] * [-ahead[1], ahead[0]]
    pixels = np.column_stack([outline[:, 0], 1 - outline[:, 1]]) * len(image)
    cv2.fillPoly(image, [np.rint(pixels).astype(np.int32)], color)


def _frond(image: Texture, leaf: Leaf, rng: np.random.Generator) -> None:
    """Draw needles on the twigs of a conifer, in an outline that narrows to the tip."""
    for up in np.linspace(0.02, 0.95, FROND_TWIGS).tolist():
        for side in (-1, 1):
            long = (0.50 - 0.44 * up) * float(rng.uniform(0.7, 1.05)) * min(1.0, 0.55 + 3 * up)
            twig = Twig(np.array([0.5, up]), np.pi / 2 + side * float(rng.uniform(0.75, 1.0)), long)
            for along in np.arange(0.0, long, NEEDLE_STEP).tolist():
                place = twig.at(along)
                if not 0.01 < place[0] < 0.99 or place[1] > 0.98:
                    break
                way = twig.way + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.9))
                _blade(image, Twig(place, way, leaf.long), leaf.wide * leaf.long, _toned(leaf, rng))


def _toned(leaf: Leaf, rng: np.random.Generator) -> tuple[int, ...]:
    """The leaf's colour, lighter or darker, opaque."""
    tone = rng.uniform(0.72, 1.22) * np.array(leaf.color) + rng.normal(0, 5, 3)
    return (*(int(c) for c in tone.clip(0, 255)), 255)


def _directions(n: int, rng: np.random.Generator) -> Array:
    """Unit vectors (n, 3) of any direction."""
    ways = rng.standard_normal((n, 3))
    return np.asarray(ways / exact.length(ways)[:, None])
