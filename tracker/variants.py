"""The tracker variants, by name."""

from tracker.base import Tracker
from tracker.canny import Canny
from tracker.hold import Hold
from tracker.lsd import Lsd, LsdSingle
from tracker.rapid import Rapid
from tracker.robust import Robust
from tracker.vo import Vo

TRACKERS: dict[str, type[Tracker]] = {
    "hold": Hold,
    "rapid": Rapid,
    "canny": Canny,
    "lsd-single": LsdSingle,
    "lsd": Lsd,
    "robust": Robust,
    "vo": Vo,
}
"""Name -> parameters of every tracker variant."""


def tracker_kind(tracker: Tracker) -> str:
    """Name of a variant in TRACKERS, or `module:class` of one from elsewhere."""
    for kind, variant in TRACKERS.items():
        if type(tracker) is variant:
            return kind
    return f"{type(tracker).__module__}:{type(tracker).__qualname__}"
