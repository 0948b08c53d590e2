"""End of a flight: collision, excessive tilt, deviation from the path, or completion."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavbench.bench.closed_loop.spec import CrashSpec
from uavbench.trajectories.kernels.compiled import compiled
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.pose import Array
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

MARGIN = 1e-9
"""Distance from every limit, in its own unit, at which round-off cannot have crossed it."""
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

    @cached_property
    def _bounds_m(self) -> Array:
        return self.obstacles.bounds

    @cached_property
    def _limits(self) -> tuple[float, float, float]:
        """Distance to the obstacles in m, cosine of the tilt, and distance to the path in m, for `_is_clear`."""
        crash = self.crash
        return crash.clearance_m + self.radius_m, float(np.cos(np.radians(crash.tilt_deg))), float(crash.stray_m)

    def ending(self, record: Array, reference: Array, first: int) -> Ending | None:
        """Ending within rows (n, 30) of a record that begin at row `first`; None while the flight goes on."""
        if _is_clear(record, reference, self._bounds_m, self._limits):
            return None
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


@compiled("f2 f2 f2 (f0 f0 f0)")
def _is_clear(record: Array, reference: Array, bounds_m: Array, limits: tuple[float, float, float]) -> bool:
    """Whether rows (n, 30) are finite and, by a margin, within all limits, outside the box of the obstacles.

    It spares most flights the exact test of `Judge.ending`, 36 us in every 20 ms.
    """
    gap_m, upright, stray_m = limits
    for n in range(len(record)):
        row = record[n]
        for k in range(len(row)):
            if not math.isfinite(row[k]):
                return False
        to_box2 = away2 = 0.0
        for k in range(3):
            outside = max(bounds_m[0, k] - row[k], row[k] - bounds_m[1, k], 0.0)
            to_box2 += outside * outside
            away2 += (row[k] - reference[n, k]) ** 2
        if not (math.sqrt(to_box2) > gap_m + MARGIN and row[2] > gap_m + MARGIN):
            return False
        if not math.sqrt(away2) < stray_m - MARGIN:
            return False
        if not 1.0 - 2.0 * (row[4] * row[4] + row[5] * row[5]) > upright + MARGIN:
            return False
    return True
