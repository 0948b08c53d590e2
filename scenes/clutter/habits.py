"""Habits of trees: the forms of their crowns, how they branch, and their leaves.

Lengths are fractions of a tree's height unless they have a unit, and are by eye where no source is named.
"""

from dataclasses import dataclass
from typing import Literal

from uavbench.scenes.materials.painted import Color

HabitName = Literal["round", "mixed", "spreading", "oval", "columnar", "birch", "spruce"]
"""`round`: a ball of leaves on a trunk; `mixed`: each tree has one of HABITS."""


@dataclass(frozen=True)
class Ring:
    """Radius of a crown at a height: up from its base, 0, to its top, 1; wide as a fraction of its largest radius."""

    up: float
    wide: float


@dataclass(frozen=True)
class Detail:
    """Number of limbs of a tree, boughs on each limb, and cards with leaves on each bough."""

    limbs: int
    boughs: int
    cards: int


@dataclass(frozen=True)
class Leaf:
    """Look of a spray of leaves: sRGB colour (0..255), length and width of a leaf and their number.

    Lengths are fractions of the spray's; needles stand on twigs in place of leaves.
    """

    color: Color
    long: float
    wide: float
    count: int
    needles: bool = False


@dataclass(frozen=True, kw_only=True)
class Habit:
    """Form of a kind of tree.

    crown_wide is the diameter of the crown; the crown reaches from crown_from to the top, with `outline`. The trunk
    ends at leader, and its radius at the ground is trunk. Limbs rise by `rises` for each unit outwards, and bow upwards
    by the fraction `bows` of their length. Boughs have the length bough. A card of leaves has the side card and hangs
    by `hangs`, 0 for along its bough, 1 for mostly down; fronds lie along limbs instead. near and far are the detail
    close to the structure and farther away, where cards are `far_card` times as large.
    """

    crown_wide: float
    crown_from: float
    outline: tuple[Ring, ...]
    leader: float
    trunk: float
    rises: float
    bows: float
    bough: float
    card: float
    leaf: Leaf
    near: Detail
    far: Detail
    far_card: float = 1.5
    hangs: float = 0.0
    fronds: bool = False
    white_bark: bool = False


FAR_M = 10.0
"""Distance from the structure's bounds, metres, from which trees have less detail: a leaf of 0.1 m on a camera of
640 px and 78.7 degrees is 4 px wide there, and the camera is farther away than the structure, or between the two."""
GOLDEN_RAD = 2.399963
"""Angle between successive limbs around the trunk, rad: the golden angle of 137.5 degrees, which most plants with
spiral phyllotaxis have (Jean 1994, Phyllotaxis)."""
STEEPER = 0.8
"""How much more limbs at the top of a crown rise for each unit outwards than those at its base: younger ones are
steeper. By eye."""
TIP_TO_BASE = 0.25
"""Radius of a limb or bough at its end, as a fraction of that at its base."""
FLARE = 1.5
"""Radius of the trunk at the ground, over that just above its roots."""
TREE_SPREAD = (0.65, 1.35)
"""Range of the heights of trees over their mean, that of `round` trees."""

OAK = Leaf((92.0, 108.0, 52.0), 0.085, 0.50, 460)
LIME = Leaf((90.0, 114.0, 56.0), 0.080, 0.72, 380)
POPLAR = Leaf((94.0, 114.0, 60.0), 0.070, 0.80, 420)
BIRCH = Leaf((108.0, 124.0, 62.0), 0.055, 0.66, 420)
SPRUCE = Leaf((62.0, 82.0, 54.0), 0.050, 0.30, 0, needles=True)
"""Looks of leaves by eye, larger than real ones in proportion to the tree, so that fewer cover as much."""

HABITS: dict[str, Habit] = {
    "spreading": Habit(
        crown_wide=0.98, crown_from=0.20,
        outline=(
            Ring(0.0, 0.50), Ring(0.15, 0.86), Ring(0.38, 1.0),
            Ring(0.62, 0.90), Ring(0.84, 0.58), Ring(1.0, 0.0),
        ),
        leader=0.62, trunk=0.034, rises=0.55, bows=0.10, bough=0.20, card=0.155, leaf=OAK,
        near=Detail(11, 8, 3), far=Detail(11, 4, 2), far_card=1.6,
    ),
    "oval": Habit(
        crown_wide=0.62, crown_from=0.18,
        outline=(
            Ring(0.0, 0.45), Ring(0.14, 0.82), Ring(0.36, 1.0),
            Ring(0.60, 0.88), Ring(0.82, 0.55), Ring(1.0, 0.0),
        ),
        leader=0.86, trunk=0.024, rises=0.9, bows=-0.08, bough=0.14, card=0.16, leaf=LIME,
        near=Detail(14, 5, 3), far=Detail(12, 3, 2),
    ),
    "columnar": Habit(
        crown_wide=0.25, crown_from=0.07,
        outline=(
            Ring(0.0, 0.45), Ring(0.12, 0.80), Ring(0.40, 1.0),
            Ring(0.70, 0.80), Ring(0.90, 0.42), Ring(1.0, 0.0),
        ),
        leader=0.92, trunk=0.020, rises=3.0, bows=-0.10, bough=0.08, card=0.11, leaf=POPLAR,
        near=Detail(24, 4, 3), far=Detail(20, 2, 2),
    ),
    "birch": Habit(
        crown_wide=0.46, crown_from=0.20,
        outline=(
            Ring(0.0, 0.55), Ring(0.18, 0.92), Ring(0.36, 1.0),
            Ring(0.62, 0.76), Ring(0.85, 0.40), Ring(1.0, 0.0),
        ),
        leader=0.95, trunk=0.015, rises=1.3, bows=0.14, bough=0.12, card=0.15, leaf=BIRCH,
        near=Detail(16, 6, 2), far=Detail(14, 3, 2), hangs=0.75, white_bark=True,
    ),
    "spruce": Habit(
        crown_wide=0.40, crown_from=0.05,
        outline=(
            Ring(0.0, 0.88), Ring(0.10, 1.0), Ring(0.40, 0.72),
            Ring(0.75, 0.38), Ring(0.92, 0.22), Ring(1.0, 0.10),
        ),
        leader=0.99, trunk=0.017, rises=-0.22, bows=-0.10, bough=0.0, card=0.0, leaf=SPRUCE,
        near=Detail(90, 0, 3), far=Detail(64, 0, 3), far_card=1.4, fronds=True,
    ),
}  # fmt: skip
"""Habits by name: an open-grown oak, a lime, a Lombardy poplar, a birch and a spruce, by eye."""
