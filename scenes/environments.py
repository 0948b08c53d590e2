"""Every environment by its name."""

from scenes.indoor import Indoor
from scenes.outdoor import Outdoor

ENVIRONMENTS: dict[str, type] = {
    "indoor": Indoor,
    "outdoor": Outdoor,
}
