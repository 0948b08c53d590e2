"""The same flight controlled by its true state: its plan, and its path error without estimation errors."""

from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.simulation.flight import begin, fly_through
from uavbench.trajectories.vehicle.quadrotor import STEP_S

PLAN_STRIDE = 50
"""Steps between two stored rows of a plan: 0.1 s."""


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """A flight on its true state: its plan (n, 5), time in s, position in m, yaw in rad, and its path error (m,)."""

    plan: Array
    error_m: Array

    @classmethod
    def of(cls, spec: SequenceSpec, obstacles: ObstacleMesh) -> "OpenLoop":
        """The flight of a sequence; UserError when it fails, crashes or has no room."""
        simulation = begin(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
        flight = replace(spec.flight, on_crash="error")
        places = fly_through(simulation, flight, spec.mount.at_rest, obstacles).positions_m
        planned = simulation.reference
        rows = np.arange(0, len(planned), PLAN_STRIDE)
        plan = np.column_stack([rows * STEP_S, planned[rows, 0:3], planned[rows, 9]])
        return cls(plan, np.linalg.norm(places - planned[:, 0:3], axis=1))
