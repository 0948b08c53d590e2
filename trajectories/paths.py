"""The paths that can be flown, by name."""

from typing import Protocol

import numpy as np

from trajectories.hand_pilot import HandPilot
from trajectories.mount import Mount
from trajectories.paths_along import FacadeRaster, GirderFollow, UndersidePass, Waypoints
from trajectories.paths_around import Approach, FigureEight, Hover, Orbit, PierSpiral
from trajectories.recorded import Recorded
from trajectories.reference import Guidance, Replay
from trajectories.surroundings import Surroundings


class PathSpec(Protocol):
    """A way to fly: a frozen dataclass of its parameters."""

    def plan(self, surroundings: Surroundings, mount: Mount, rng: np.random.Generator) -> Guidance | Replay:
        """Guidance along the path, or a motion known already; UserError when the surroundings leave no room for it."""
        ...


PATHS: dict[str, type[PathSpec]] = {
    "hand-pilot": HandPilot,
    "orbit": Orbit,
    "facade-raster": FacadeRaster,
    "girder-follow": GirderFollow,
    "underside-pass": UndersidePass,
    "pier-spiral": PierSpiral,
    "approach": Approach,
    "hover": Hover,
    "figure-eight": FigureEight,
    "waypoints": Waypoints,
    "recorded": Recorded,
}
