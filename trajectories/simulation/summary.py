"""Duration and speed of a path: requested, planned and flown."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from uavbench.trajectories import reproducible_math as exact
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.own_path import plan
from uavbench.trajectories.paths.reference import Planned, Replay
from uavbench.trajectories.paths.timing import requested_speed
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.simulation.flight import FlightSpec, path_name
from uavbench.trajectories.vehicle.quadrotor import STEP_S

NEARLY_STILL = 0.1
"""Fraction of the highest speed below which a vehicle counts as nearly still."""
REACHED = 0.99
"""Fraction of the requested speed from which it counts as reached."""


@dataclass(frozen=True, kw_only=True)
class FlightSummary:
    """Key figures of a flight; None where not requested, not planned ahead, or not flown yet.

    Speeds are the highest ones. nearly_still_s is the time at the beginning before the vehicle reaches a tenth of its
    highest speed.
    """

    path: str
    duration_s: float
    duration_asked_s: float | None
    speed_asked_m_s: float | None
    speed_planned_m_s: float | None
    nearly_still_s: float | None
    length_m: float | None = None
    speed_flown_m_s: float | None = None

    def to_json(self) -> dict[str, Any]:
        """JSON object, its numbers rounded so that they are the same on every processor."""
        return {key: round(value, 6) if isinstance(value, float) else value for key, value in asdict(self).items()}

    def shortfall(self) -> str:
        """Requested values that the flight does not reach, as text; "" if it reaches all."""
        asked, planned = self.speed_asked_m_s, self.speed_planned_m_s
        if asked is None or planned is None or planned >= REACHED * asked:
            return ""
        still = f", its first {self.nearly_still_s:.1f} s nearly still" if self.nearly_still_s else ""
        return (
            f"path {self.path}: at most {planned:.2f} of the requested {asked:g} m/s, {self.duration_s:.1f} s"
            f"{still}; limited by acceleration_m_s2 or a short path: raise acceleration_m_s2, or give duration_s"
        )


def planned_summary(spec: FlightSpec, mount: Mount, obstacles: ObstacleMesh, seed: int) -> FlightSummary:
    """Summary of a flight before it is flown; UserError when its path cannot be planned."""
    guidance = plan(spec.path, obstacles, mount, stream(seed, "path"))
    steps = len(guidance.record) if isinstance(guidance, Replay) else guidance.steps
    speeds = exact.length(guidance.table[:, 3:6]) if isinstance(guidance, Planned) else None
    return FlightSummary(
        path=path_name(spec.path),
        duration_s=(steps - 1) * STEP_S,
        duration_asked_s=getattr(spec.path, "duration_s", None),
        speed_asked_m_s=requested_speed(spec.path),
        speed_planned_m_s=None if speeds is None else float(speeds.max()),
        nearly_still_s=None if speeds is None else _nearly_still_s(speeds),
    )


def flown_summary(spec: FlightSpec, mount: Mount, obstacles: ObstacleMesh, seed: int, flight: Flight) -> FlightSummary:
    """Summary of a flight that was flown."""
    planned = planned_summary(spec, mount, obstacles, seed)
    speeds = exact.length(flight.velocities_m_s)
    values = planned.to_json() | {
        "duration_s": float(flight.stamps_ns[-1]) / 1e9,
        "nearly_still_s": _nearly_still_s(speeds),
        "length_m": flight.trajectory.length_m,
        "speed_flown_m_s": float(speeds.max()),
    }
    return FlightSummary(**values)


def _nearly_still_s(speeds: Array) -> float:
    return float(np.argmax(speeds >= NEARLY_STILL * speeds.max())) * STEP_S
