"""The paths that can be flown, by name."""

from typing import Protocol

import numpy as np

from trajectories.hand_pilot import HandPilot
from trajectories.mount import Mount
from trajectories.reference import Guidance
from trajectories.surroundings import Surroundings


class PathSpec(Protocol):
    """A way to fly: a frozen dataclass of its parameters."""

    def plan(self, surroundings: Surroundings, mount: Mount, rng: np.random.Generator) -> Guidance:
        """Guidance along the path; UserError when the surroundings leave no room for it."""
        ...


PATHS: dict[str, type[PathSpec]] = {"hand-pilot": HandPilot}
