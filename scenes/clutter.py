"""Every kind of clutter by its name."""

from scenes.birds import Birds
from scenes.lookalikes import Lookalikes
from scenes.people import People
from scenes.trees import Trees

CLUTTER: dict[str, type] = {
    "lookalikes": Lookalikes,
    "trees": Trees,
    "people": People,
    "birds": Birds,
}
