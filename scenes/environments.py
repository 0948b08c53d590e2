"""Every environment by its name."""

from scenes.indoor import Indoor

ENVIRONMENTS: dict[str, type] = {
    "indoor": Indoor,
}
