"""Every plug-in point: the protocol, its registry, and the method that a plug-in must have."""

from typing import Any

from uavbench.bench.closed_loop.latency import LATENCIES, LatencySpec
from uavbench.bench.closed_loop.trackers import FLIGHT_TRACKERS
from uavbench.bench.external.program import External
from uavbench.bench.third_party.registry import THIRD_PARTY
from uavbench.scenes.clutter.registry import CLUTTER
from uavbench.scenes.effects.registry import EFFECTS
from uavbench.scenes.spec import ClutterSpec, EffectSpec, EnvironmentSpec, StructureSpec
from uavbench.scenes.structures.registry import STRUCTURES
from uavbench.scenes.world.registry import ENVIRONMENTS
from uavbench.tracker.images.recorded_sequence import RECORDINGS, RecordingSource
from uavbench.tracker.initialization import INITIALIZATIONS, Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.registry import TRACKERS
from uavbench.trajectories.camera_mount import MountSpec
from uavbench.trajectories.gimbal.registry import FIXED, MOUNTS
from uavbench.trajectories.paths.registry import PATHS, PathSpec
from uavbench.trajectories.sensors.registry import SENSORS, SensorSpec
from uavbench.trajectories.vehicle.registry import AIRFRAMES, AirframeSpec
from uavbench.trajectories.wind.winds import WINDS, WindSpec

PLUGINS: dict[Any, tuple[dict[str, type], str]] = {
    StructureSpec: (STRUCTURES, "build"),
    EnvironmentSpec: (ENVIRONMENTS, "build"),
    ClutterSpec: (CLUTTER, "build"),
    EffectSpec: (EFFECTS, "start"),
    PathSpec: (PATHS, "plan"),
    AirframeSpec: (AIRFRAMES, "build"),
    WindSpec: (WINDS, "start"),
    SensorSpec: (SENSORS, "measure"),
    MountSpec: (MOUNTS, "along"),
    Initialization: (INITIALIZATIONS, "initial_pose"),
    RecordingSource: (RECORDINGS, "find"),
    Tracker: ({**TRACKERS, **THIRD_PARTY, **FLIGHT_TRACKERS, "external": External}, "start"),
    LatencySpec: (LATENCIES, "delay_ns"),
}
"""Protocol -> (name -> class, method)."""
DEFAULT_KINDS: dict[Any, str] = {MountSpec: FIXED}
"""Protocol whose registry is closed to a user's own plug-ins -> the kind of a table that names none."""
