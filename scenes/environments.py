"""Every environment by its name."""

from scenes.indoor import Indoor
from scenes.outdoor import Outdoor
from scenes.studio import Studio

ENVIRONMENTS: dict[str, type] = {
    "indoor": Indoor,
    "outdoor": Outdoor,
    "studio": Studio,
}
