"""Registry of clutter by kind."""

from uavbench.scenes.clutter.birds import Birds
from uavbench.scenes.clutter.lookalikes import Lookalikes
from uavbench.scenes.clutter.people import People
from uavbench.scenes.clutter.trees import Trees

ON_GROUND = (Lookalikes, Trees, People)
"""Kinds that stand on the ground, whose `build` takes a `Free` predicate."""
CLUTTER: dict[str, type] = {
    "lookalikes": Lookalikes,
    "trees": Trees,
    "people": People,
    "birds": Birds,
}
