"""Registry of airframes by name."""

from typing import Protocol

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.vehicle.airframe_file import AirframeFile
from uavbench.trajectories.vehicle.airframes import PRESETS


class AirframeSpec(Protocol):
    """A vehicle: a frozen dataclass that makes a MuJoCo model of it."""

    def build(self, mount: Mount) -> str:
        """MJCF of the vehicle with a camera on this mount; see quadrotor.xml for what it must contain."""
        ...


AIRFRAMES: dict[str, type[AirframeSpec]] = {**PRESETS, "file": AirframeFile}
