"""Pose of a camera at any time of a flight."""

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.pose import Array, Pose


class Motion(Protocol):
    """Poses `world_from_body` of a flight by row; rows may still be added."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of all rows, including those not flown yet."""
        ...

    def __len__(self) -> int:
        """Number of rows so far."""
        ...

    def pose(self, row: int) -> Pose:
        """Pose of a row."""
        ...


def camera_path(flight: Motion, cam_from_body: Pose) -> Callable[[int], Pose]:
    """`cam_from_world` at any time (ns), interpolated with constant twist between rows and extrapolated at the ends."""
    stamps = flight.stamps_ns

    @lru_cache(maxsize=8)
    def start_and_twist(row: int) -> tuple[Pose, Array]:
        world_from_body = flight.pose(row)
        return world_from_body, (world_from_body.inverse() @ flight.pose(row + 1)).log()

    def at(stamp_ns: int) -> Pose:
        rows = len(flight)
        if rows == 1:
            return cam_from_body @ flight.pose(0).inverse()
        row = int(np.clip(np.searchsorted(stamps[:rows], stamp_ns, side="right") - 1, 0, rows - 2))
        world_from_body, twist = start_and_twist(row)
        share = (stamp_ns - int(stamps[row])) / int(stamps[row + 1] - stamps[row])
        if share != 0.0:
            world_from_body = world_from_body @ Pose.exp(share * twist)
        return cam_from_body @ world_from_body.inverse()

    return at
