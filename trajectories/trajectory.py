"""A trajectory: stamped poses of one moving frame in one fixed frame."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array, Pose, read_only, rotation_from_quaternion


class InvalidRowError(ValueError):
    """A row of a trajectory, counted from 0, that is invalid, and what is wrong with it."""

    def __init__(self, row: int, what: str) -> None:
        super().__init__(f"row {row}: {what}")
        self.row, self.what = row, what


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Stamped poses `world_from_x`; arrays are read-only.

    stamps_ns (n,) int64, strictly increasing; positions_m (n, 3); quaternions_wxyz (n, 4), unit.
    Raises InvalidRowError naming the row (0-based) of the first bad stamp, position or quaternion.

    >>> import numpy as np
    >>> upright = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    >>> flown = Trajectory(np.array([0, 10, 20]), np.array([[0, 0, 1], [3, 4, 1], [6, 8, 1]]), upright)
    >>> flown.length_m
    10.0
    >>> flown.pose(2).translation.tolist()
    [6.0, 8.0, 1.0]
    """

    stamps_ns: NDArray[np.int64]
    positions_m: Array
    quaternions_wxyz: Array

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns)
        if not np.issubdtype(stamps.dtype, np.integer):
            raise ValueError("stamps_ns must be integer nanoseconds")
        if stamps.ndim != 1:
            raise ValueError(f"stamps_ns has the shape {stamps.shape}; give (n,)")
        if stamps.dtype.kind == "u" and stamps.size and stamps.max() > np.iinfo(np.int64).max:
            raise InvalidRowError(int(np.argmax(stamps)), "stamp is beyond 2^63 ns")
        stamps = stamps.astype(np.int64)
        stamps.setflags(write=False)
        n = stamps.size
        object.__setattr__(self, "stamps_ns", stamps)
        object.__setattr__(self, "positions_m", read_only(self.positions_m, (n, 3)))
        q = read_only(self.quaternions_wxyz, (n, 4))
        for name, bad in (
            ("position is not finite", ~np.isfinite(self.positions_m).all(axis=1)),
            ("quaternion is not finite or not of unit norm (1e-3)", ~(np.abs(np.linalg.norm(q, axis=1) - 1) < 1e-3)),
            ("stamp is not later than the previous one", np.concatenate([[False], stamps[1:] <= stamps[:-1]])),
        ):
            if bad.any():
                raise InvalidRowError(int(np.argmax(bad)), name)
        object.__setattr__(self, "quaternions_wxyz", q)

    @classmethod
    def from_poses(cls, stamps_ns: Iterable[int], world_from_x: Iterable[Pose]) -> Self:
        """Trajectory of poses, one per stamp; ValueError for stamps that are no integers, as seconds."""
        poses = list(world_from_x)
        return cls(
            np.array(list(stamps_ns) or np.zeros(0, np.int64)),
            np.array([p.translation for p in poses]).reshape(-1, 3),
            np.array([p.quaternion_wxyz for p in poses]).reshape(-1, 4),
        )

    def __len__(self) -> int:
        return int(self.stamps_ns.size)

    def pose(self, i: int) -> Pose:
        """Pose `world_from_x` of row `i`."""
        return Pose.from_quaternion(self.quaternions_wxyz[i], self.positions_m[i])

    @property
    def rotations(self) -> Array:
        """Rotation matrices (n, 3, 3)."""
        return rotation_from_quaternion(self.quaternions_wxyz)

    def select(self, rows: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "Trajectory":
        """Trajectory of the chosen rows."""
        return Trajectory(self.stamps_ns[rows], self.positions_m[rows], self.quaternions_wxyz[rows])

    @property
    def length_m(self) -> float:
        """Length of the path through all positions, metres."""
        return float(np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1).sum())
