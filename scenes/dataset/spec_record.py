"""A spec as the JSON value of its TOML table, for the record of a dataset."""

from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

from uavbench.scenes.clutter.registry import CLUTTER
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.structures.registry import STRUCTURES
from uavbench.scenes.world.registry import ENVIRONMENTS
from uavbench.trajectories.gimbal.registry import FIXED, MOUNTS
from uavbench.trajectories.paths.registry import PATHS
from uavbench.trajectories.sensors.registry import SENSORS
from uavbench.trajectories.vehicle.registry import AIRFRAMES
from uavbench.trajectories.wind.winds import WINDS

PLAIN = (bool, int, float, str, type(None))


def described(value: Any) -> Any:
    """JSON value of a spec: tables by key, plug-ins with their `kind`, a plug-in of the user's own by its class."""
    if isinstance(value, PLAIN):
        return value
    if is_dataclass(value) and not isinstance(value, type):
        table = {f.name: described(getattr(value, f.name)) for f in fields(value) if f.init}
        kind = _kinds().get(type(value))
        if kind is None and type(value).__module__.split(".")[0] != "uavbench":
            kind = f"{type(value).__module__}:{type(value).__qualname__}"
            if measured := getattr(type(value), "measured", ()):
                table["measured"] = list(measured)  # of a sensor: columns that are provided to trackers
        return table if kind is None else {"kind": kind, **table}
    if isinstance(value, list | tuple):
        return [described(item) for item in value]
    if isinstance(value, dict):
        return {str(key): described(item) for key, item in value.items()}
    return str(value)


@cache
def _kinds() -> dict[type, str]:
    registries = (STRUCTURES, ENVIRONMENTS, CLUTTER, EFFECTS, PATHS, AIRFRAMES, WINDS, SENSORS)
    named = {cls: kind for registry in registries for kind, cls in registry.items()}
    return named | {cls: kind for kind, cls in MOUNTS.items() if kind != FIXED}
