"""Every plug-in point: the protocol, its registry, and the verb that a plug-in must have."""

from typing import Any

from bench.external import External
from bench.peers.registry import PEERS
from scenes.clutter import CLUTTER
from scenes.effects import EFFECTS
from scenes.environments import ENVIRONMENTS
from scenes.spec import ClutterSpec, EffectSpec, EnvironmentSpec, StructureSpec
from scenes.structures import STRUCTURES
from tracker.base import Tracker
from tracker.initial_pose import INITIALIZATIONS, Initialization
from tracker.recording import RECORDINGS, RecordingSource
from tracker.variants import TRACKERS
from trajectories.airframes import AIRFRAMES, AirframeSpec
from trajectories.paths import PATHS, PathSpec
from trajectories.sensors import SENSORS, SensorSpec
from trajectories.wind import WINDS, WindSpec

PLUGINS: dict[Any, tuple[dict[str, type], str]] = {
    StructureSpec: (STRUCTURES, "build"),
    EnvironmentSpec: (ENVIRONMENTS, "build"),
    ClutterSpec: (CLUTTER, "build"),
    EffectSpec: (EFFECTS, "start"),
    PathSpec: (PATHS, "plan"),
    AirframeSpec: (AIRFRAMES, "build"),
    WindSpec: (WINDS, "start"),
    SensorSpec: (SENSORS, "measure"),
    Initialization: (INITIALIZATIONS, "first_pose"),
    RecordingSource: (RECORDINGS, "find"),
    Tracker: ({**TRACKERS, **PEERS, "external": External}, "start"),
}
"""Protocol -> (name -> class, verb)."""
