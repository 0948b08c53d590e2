"""Ground truth of a flight at every control step."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array, Pose, read_only
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.trajectory import Trajectory

Status = Literal["completed", "crashed"]


@dataclass(frozen=True, eq=False)
class Flight:
    """Ground truth of one flight, one row per control step; arrays are read-only.

    stamps_ns (n,) int64 from step counts, 0 first; world_from_body as positions_m (n, 3) and quaternions_wxyz (n, 4);
    velocities_m_s and accelerations_m_s2 (n, 3) of the body's origin in the world (kinematic: 0 in hover);
    angular_velocities_rad_s and angular_accelerations_rad_s2 (n, 3) in the body; thrust_commands_n and thrusts_n
    (n, 4) of the four rotors; winds_m_s (n, 3) of the air in the world. A crashed flight ends at crashed_ns, its last
    row, touching floor or structure.
    """

    stamps_ns: NDArray[np.int64]
    positions_m: Array
    quaternions_wxyz: Array
    velocities_m_s: Array
    accelerations_m_s2: Array
    angular_velocities_rad_s: Array
    angular_accelerations_rad_s2: Array
    thrust_commands_n: Array
    thrusts_n: Array
    winds_m_s: Array
    status: Status = "completed"
    crashed_ns: int | None = None

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        stamps.setflags(write=False)
        object.__setattr__(self, "stamps_ns", stamps)
        n = stamps.size
        for name, columns in (
            ("positions_m", 3),
            ("quaternions_wxyz", 4),
            ("velocities_m_s", 3),
            ("accelerations_m_s2", 3),
            ("angular_velocities_rad_s", 3),
            ("angular_accelerations_rad_s2", 3),
            ("thrust_commands_n", 4),
            ("thrusts_n", 4),
            ("winds_m_s", 3),
        ):
            object.__setattr__(self, name, read_only(getattr(self, name), (n, columns)))
        if (self.status == "crashed") != (self.crashed_ns is not None):
            raise ValueError("a flight has a crash time exactly when its status is crashed")

    @classmethod
    def of_rows(cls, stamps_ns: NDArray[np.int64], rows: Array) -> "Flight":
        """Flight of rows (n, 30) of a record in progress, as unchecked views, made on access, without a copy."""
        flight = object.__new__(cls)
        vars(flight).update(stamps_ns=stamps_ns, _rows=rows)
        return flight

    def __getattr__(self, name: str) -> Array:
        """A column of a flight of `of_rows`."""
        if name not in RECORD or "_rows" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        column: Array = vars(self)["_rows"][:, RECORD[name]]
        return column

    def __len__(self) -> int:
        return int(self.stamps_ns.size)

    @property
    def trajectory(self) -> Trajectory:
        """Trajectory world_from_body of every row."""
        return Trajectory(self.stamps_ns, self.positions_m, self.quaternions_wxyz)

    def pose(self, row: int) -> Pose:
        """Pose world_from_body of a row."""
        return Pose.from_quaternion(self.quaternions_wxyz[row], self.positions_m[row])
