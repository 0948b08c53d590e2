"""A studio: the structure in plain colours on a uniform grey background, without shadows; a tracker's best case."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Interval

from uavbench.scenes.renderables import BuiltEnvironment, BuiltStructure, Confines, Light, Streams
from uavbench.trajectories.pose import Array

SKY_PX = (8, 16)
ABOVE, BELOW = 1.0, 0.2
"""Light from above and from below; with its gradient along x, any two faces of a box differ by a fifth or more."""


@dataclass(frozen=True)
class Studio:
    """The structure alone: each surface in the mean colour of its texture, on a uniform grey background.

    Light is ambient, stronger from above and along x; there is no lamp, and hence no shadow. backdrop is the linear
    radiance of the background.
    """

    brightness: Annotated[float, Gt(0), Interval(le=10)] = 1.0
    backdrop: Annotated[float, Interval(ge=0, le=1)] = 0.02

    def confines(self, built: BuiltStructure, rng: np.random.Generator, streams: Streams) -> Confines:
        """None: there is neither ground nor wall."""
        return Confines()

    def build(self, bounds: Array, rng: np.random.Generator) -> BuiltEnvironment:
        """The light and the background; both are deterministic."""
        light = Light(
            to_lamp=(1.0, 0.0, 0.0),
            lamp=(0.0, 0.0, 0.0),
            above=(self.brightness * ABOVE,) * 3,
            below=(self.brightness * BELOW,) * 3,
            shadow_map=False,
        )
        sky = np.full((*SKY_PX, 3), round(255 * float(np.sqrt(self.backdrop))), dtype=np.uint8)
        return BuiltEnvironment((), light, sky, textures=False)
