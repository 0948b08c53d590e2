"""Pose of a camera at any time of a flight."""

from collections.abc import Callable
from functools import lru_cache

from uavbench.trajectories.camera_mount import Motion
from uavbench.trajectories.pose import Array, Pose

__all__ = ["Motion", "body_path", "camera_path", "mounted_path"]

KEPT_POSES = 8
"""Times at which poses of a camera are kept: drawing, antialiasing and every annotation of a frame ask for the same."""


def camera_path(flight: Motion, cam_from_body: Pose) -> Callable[[int], Pose]:
    """`cam_from_world` at any time (ns) of a camera with a fixed mount, interpolated as `body_path`."""
    return mounted_path(flight, lambda stamp_ns: cam_from_body)


def mounted_path(flight: Motion, cam_from_body: Callable[[int], Pose]) -> Callable[[int], Pose]:
    """`cam_from_world` at any time (ns) of a camera whose pose on the body depends on time."""
    world_from_body = body_path(flight)

    @lru_cache(maxsize=KEPT_POSES)
    def at(stamp_ns: int, rows: int) -> Pose:  # a flight in progress is extrapolated until it has more rows
        return cam_from_body(stamp_ns) @ world_from_body(stamp_ns).inverse()

    return lambda stamp_ns: at(stamp_ns, len(flight))


def body_path(flight: Motion) -> Callable[[int], Pose]:
    """`world_from_body` at any time (ns), by constant twist between rows, extrapolated at the ends."""
    stamps = flight.stamps_ns

    @lru_cache(maxsize=8)
    def start_and_twist(row: int) -> tuple[Pose, Array]:
        world_from_body = flight.pose(row)
        return world_from_body, (world_from_body.inverse() @ flight.pose(row + 1)).log()

    def at(stamp_ns: int) -> Pose:
        rows = len(flight)
        if rows == 1:
            return flight.pose(0)
        row = min(max(int(stamps[:rows].searchsorted(stamp_ns, side="right")) - 1, 0), rows - 2)
        world_from_body, twist = start_and_twist(row)
        share = (stamp_ns - int(stamps[row])) / int(stamps[row + 1] - stamps[row])
        return world_from_body if share == 0.0 else world_from_body @ Pose.exp(share * twist)

    return at
