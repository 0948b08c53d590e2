"""Every kind of clutter by its name."""

from uavbench.scenes.clutter.birds import Birds
from uavbench.scenes.clutter.lookalikes import Lookalikes
from uavbench.scenes.clutter.people import People
from uavbench.scenes.clutter.trees import Trees

ON_GROUND = (Lookalikes, Trees, People)
"""Kinds whose `build` takes the predicate of free ground."""
CLUTTER: dict[str, type] = {
    "lookalikes": Lookalikes,
    "trees": Trees,
    "people": People,
    "birds": Birds,
}
