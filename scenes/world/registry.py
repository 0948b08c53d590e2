"""Registry of environments by kind."""

from uavbench.scenes.world.indoor import Indoor
from uavbench.scenes.world.outdoor import Outdoor
from uavbench.scenes.world.studio import Studio

ENVIRONMENTS: dict[str, type] = {
    "indoor": Indoor,
    "outdoor": Outdoor,
    "studio": Studio,
}
