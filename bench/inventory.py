"""What there is to name in a suite: `uavbench list`."""

import textwrap

from bench.plugins import PLUGINS
from bench.suite_files import suite_names, suite_title


def inventory() -> str:
    """Suites and plug-ins by kind, each with the first sentence of what it is."""
    lines = ["suites"]
    for name in suite_names():
        lines.append(f"  {name:<22} {suite_title(name)}")
    for protocol, (registry, _) in PLUGINS.items():
        lines.append(f"\n{TITLES.get(protocol.__name__, protocol.__name__)}")
        for kind, cls in registry.items():
            about = textwrap.shorten((cls.__doc__ or "").split("\n\n")[0], 90, placeholder=" ...")
            lines.append(f"  {kind:<22} {about}")
    return "\n".join(lines)


TITLES = {
    "StructureSpec": "structures",
    "EnvironmentSpec": "environments",
    "ClutterSpec": "clutter",
    "EffectSpec": "effects",
    "PathSpec": "paths",
    "AirframeSpec": "airframes",
    "WindSpec": "winds",
    "SensorSpec": "body sensors",
    "Initialization": "first poses",
    "RecordingSource": "recordings",
    "Tracker": "trackers",
}
