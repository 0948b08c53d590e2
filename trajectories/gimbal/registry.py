"""Registry of camera mounts by name."""

from uavbench.trajectories.camera_mount import Mount, MountSpec
from uavbench.trajectories.gimbal.gimbal import Gimbal

FIXED = "fixed"
"""Kind of a mount whose table names none."""

MOUNTS: dict[str, type[MountSpec]] = {
    "fixed": Mount,
    "gimbal": Gimbal,
}
