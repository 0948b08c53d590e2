"""Every kind of clutter by its name."""

from scenes.lookalikes import Lookalikes

CLUTTER: dict[str, type] = {
    "lookalikes": Lookalikes,
}
