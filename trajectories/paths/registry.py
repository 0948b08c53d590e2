"""Registry of flight paths by name."""

from typing import Protocol

import numpy as np

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.along import FacadeRaster, GirderFollow, UndersidePass, Waypoints
from uavbench.trajectories.paths.around import Approach, FigureEight, Hover, Orbit, PierSpiral
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.paths.recorded import Recorded
from uavbench.trajectories.paths.reference import Guidance, Replay


class PathSpec(Protocol):
    """A flight path: a frozen dataclass of its parameters."""

    def plan(self, obstacles: ObstacleMesh, mount: Mount, rng: np.random.Generator) -> Guidance | Replay:
        """Guidance along the path, or a known motion to replay; UserError when the obstacles leave no room for it."""
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
