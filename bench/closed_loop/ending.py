"""End of a flight: collision, excessive tilt, deviation from the path, or completion."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.spec import CrashSpec
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

FlightStatus = Literal["completed", "crashed", "strayed", "timed out", "stopped"]


@dataclass(frozen=True)
class Ending:
    """Status of a flight at its end, the reason as text, and the stamp."""

    status: FlightStatus
    why: str
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class Judge:
    """Detects the end of a flight of a vehicle of radius_m among obstacles."""

    crash: CrashSpec
    radius_m: float
    obstacles: ObstacleMesh

    def ending(self, record: Array, reference: Array, first: int) -> Ending | None:
        """Ending within rows (n, 30) of a record that begin at row `first`; None while the flight goes on."""
        places = record[:, RECORD["positions_m"]]
        known = np.isfinite(record).all(axis=1)
        if not known.all():
            return Ending("crashed", "the vehicle lost control", (first + int(np.argmin(known))) * STEP_NS)
        x, y = record[:, RECORD["quaternions_wxyz"]][:, 1:3].T
        upright = 1.0 - 2.0 * (x * x + y * y)
        to_structure = self.obstacles.distance(places) - self.radius_m
        to_floor = places[:, 2] - self.radius_m
        away = np.linalg.norm(places - reference[:, 0:3], axis=1)
        crash = self.crash
        causes: list[tuple[FlightStatus, str, NDArray[np.bool_]]] = [
            ("crashed", "it came too close to the structure", to_structure < crash.clearance_m),
            ("crashed", "it came too close to the floor", to_floor < crash.clearance_m),
            ("crashed", f"it tilted beyond {crash.tilt_deg:g} degrees", upright < np.cos(np.radians(crash.tilt_deg))),
            ("strayed", f"it was more than {crash.stray_m:g} m from its path", away > crash.stray_m),
        ]
        found = [(int(np.argmax(bad)), status, why) for status, why, bad in causes if bad.any()]
        if not found:
            return None
        row, status, why = min(found, key=lambda each: each[0])
        x_m, y_m, z_m = places[row].tolist()
        return Ending(status, f"{why}, at ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m", (first + row) * STEP_NS)
