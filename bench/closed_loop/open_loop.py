"""The same flight controlled by its true state: its plan, and its path error without estimation errors."""

from dataclasses import dataclass, replace

import numpy as np

from uavbench.scenes.renderables import Confines
from uavbench.scenes.shots.cameras import cameras_of, lens_of
from uavbench.scenes.shots.confines import check_confines
from uavbench.scenes.shots.targets import missed_targets
from uavbench.scenes.spec import SequenceSpec
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.sensors.sensor import check_rate, stamps_between
from uavbench.trajectories.simulation.flight import begin, fly_through
from uavbench.trajectories.vehicle.quadrotor import STEP_S

PLAN_STRIDE = 50
"""Steps between two stored rows of a plan: 0.1 s."""


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """A flight on its true state: its plan (n, 5), time in s, position in m, yaw in rad, and its path error (m,).

    unreached: what its gimbal does not reach.
    """

    plan: Array
    error_m: Array
    unreached: tuple[str, ...] = ()

    @classmethod
    def of(cls, spec: SequenceSpec, rate_hz: float, obstacles: ObstacleMesh, confines: Confines) -> "OpenLoop":
        """The flight of a sequence with frames at rate_hz.

        UserError when it fails, crashes or has no room, when its camera leaves the scene, its gimbal never sees its
        target, or the rate does not fit.
        """
        lens_of(spec, cameras_of(spec)[0])
        simulation = begin(spec.flight, spec.mount.at_rest, obstacles, spec.seed)
        flight = replace(spec.flight, on_crash="error")
        flown = fly_through(simulation, flight, spec.mount.at_rest, obstacles)
        check_confines(spec, flown, confines)
        mount = spec.mount.along(flown, obstacles.centre)
        flown_ns = int(flown.stamps_ns[-1])
        check_rate(rate_hz, flown_ns, "frame", "rates_hz")
        stamps_ns = stamps_between(0, flown_ns, rate_hz)
        missed = missed_targets(spec, [mount], [stamps_ns])
        planned = simulation.reference
        rows = np.arange(0, len(planned), PLAN_STRIDE)
        plan = np.column_stack([rows * STEP_S, planned[rows, 0:3], planned[rows, 9]])
        return cls(plan, np.linalg.norm(flown.positions_m - planned[:, 0:3], axis=1), tuple(missed))
