"""Registry of the third-party trackers: their setup, and whether they are available."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from uavbench.bench.third_party.opencv_rapid import OpencvRapid
from uavbench.bench.third_party.tracker import SETUP, ThirdPartyTracker
from uavbench.bench.third_party.visp import Visp
from uavbench.tracker.protocol import Tracker
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.seals import sealed_kind
from uavbench.trajectories.files.writing import write_text

THIRD_PARTY: dict[str, type[ThirdPartyTracker]] = {"visp": Visp, "opencv-rapid": OpencvRapid}
"""Name of each third-party tracker -> class with its parameters."""


def absent(trackers: Mapping[str, Tracker]) -> dict[str, str]:
    """Reason for each tracker that is not available on this machine, by label."""
    theirs = {label: tracker for label, tracker in trackers.items() if isinstance(tracker, ThirdPartyTracker)}
    return {label: why for label, tracker in theirs.items() if (why := tracker.absence())}


def status() -> Iterator[str]:
    """A line of text for each third-party tracker: its folder, or why it is not available."""
    for name, tracker in THIRD_PARTY.items():
        yield f"{name:<14} {tracker.absence() or tracker.folder()}"


def setup(name: str) -> str:
    """Set up a third-party tracker and return its folder; UserError for an unknown name or a missing dependency."""
    if name not in THIRD_PARTY:
        raise unknown_name("third-party tracker", name, list(THIRD_PARTY))
    tracker, home = THIRD_PARTY[name], Path(os.path.expanduser("~"))  # noqa: PTH111, raises nothing
    if tracker.folder().is_relative_to(home) and not home.is_dir():
        raise UserError(f"{home}: is your home by HOME, and is missing; name a folder in UAVBENCH_THIRD_PARTY")
    _claim(tracker.folder())
    tracker.mark(tracker.setup())
    return str(tracker.folder())


def _claim(folder: Path) -> None:
    """Mark a folder as made for a third-party tracker; UserError when it holds something else."""
    marker = folder / "setup.json"
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UserError(f"{folder}: is not a folder; name another place in UAVBENCH_THIRD_PARTY")
    if folder.is_dir() and any(folder.iterdir()) and sealed_kind(marker) != SETUP:
        raise UserError(f"{folder}: holds something that `uavbench third-party setup` did not write; move it")
    write_text(marker, '{\n "made": "by uavbench third-party setup"\n}\n', kind=SETUP)
