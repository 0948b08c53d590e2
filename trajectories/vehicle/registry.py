"""Registry of airframes by name."""

from typing import Protocol

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.vehicle.airframe_file import AirframeFile
from uavbench.trajectories.vehicle.airframes import PRESETS
from uavbench.trajectories.vehicle.quadrotor import Quadrotor


class AirframeSpec(Protocol):
    """A vehicle: a frozen dataclass that makes a MuJoCo model of it."""

    def build(self, mount: Mount) -> str:
        """MJCF of the vehicle with a camera on this mount; see quadrotor.xml for what it must contain."""
        ...


AIRFRAMES: dict[str, type[AirframeSpec]] = {**PRESETS, "file": AirframeFile}


def vehicle_of(airframe: AirframeSpec, mount: Mount) -> Quadrotor:
    """The vehicle of an airframe with a camera on this mount; UserError for one that a second `build` makes otherwise.

    And as `Quadrotor.from_mjcf`, which for a user's own airframe begins with the name of its class.
    """
    if type(airframe) in AIRFRAMES.values():
        return Quadrotor.from_mjcf(airframe.build(mount))
    name = f"airframe {type(airframe).__module__}:{type(airframe).__name__}"
    built, again = airframe.build(mount), airframe.build(mount)
    try:
        vehicle = Quadrotor.from_mjcf(built)
    except UserError as error:
        raise UserError(f"{name}: {error}") from None
    if built != again:
        raise UserError(
            f"{name}: build gives another vehicle each time; take its numbers from its parameters alone, and nothing "
            "from random numbers, the clock or an earlier call"
        )
    return vehicle
