"""Registry of trackers by name."""

from uavbench.tracker.baselines.hold import Hold
from uavbench.tracker.baselines.visual_odometry import Vo
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.robust.tracker import Robust
from uavbench.tracker.shang_shen.canny import Canny
from uavbench.tracker.shang_shen.lsd import Lsd, LsdSingle
from uavbench.tracker.shang_shen.rapid import Rapid

TRACKERS: dict[str, type[Tracker]] = {
    "hold": Hold,
    "rapid": Rapid,
    "canny": Canny,
    "lsd-single": LsdSingle,
    "lsd": Lsd,
    "robust": Robust,
    "vo": Vo,
}
"""Name -> parameters of a tracker."""


def tracker_kind(tracker: Tracker) -> str:
    """Name of a tracker in TRACKERS, or `module:class` of a user's plug-in."""
    for kind, variant in TRACKERS.items():
        if type(tracker) is variant:
            return kind
    return f"{type(tracker).__module__}:{type(tracker).__qualname__}"
