"""Every peer by its name: set up, present or absent."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from uavbench.bench.third_party.opencv_rapid import OpencvRapid
from uavbench.bench.third_party.peer import Peer
from uavbench.bench.third_party.visp import Visp
from uavbench.tracker.protocol import Tracker
from uavbench.trajectories.errors import UserError, unknown_name
from uavbench.trajectories.files.seals import is_sealed
from uavbench.trajectories.files.writing import write_text

PEERS: dict[str, type[Peer]] = {"visp": Visp, "opencv-rapid": OpencvRapid}
"""Name -> parameters of every peer."""


def absent(trackers: Mapping[str, Tracker]) -> dict[str, str]:
    """Why each of the trackers that cannot run here is absent, by label."""
    peers = {label: tracker for label, tracker in trackers.items() if isinstance(tracker, Peer)}
    return {label: why for label, peer in peers.items() if (why := peer.absence())}


def status() -> Iterator[str]:
    """A line for each peer."""
    for name, peer in PEERS.items():
        yield f"{name:<14} {peer.absence() or peer.folder()}"


def setup(name: str) -> str:
    """Set a peer up; where it is. UserError when there is none of that name, or saying what is missing."""
    if name not in PEERS:
        raise unknown_name("peer", name, list(PEERS))
    peer = PEERS[name]
    _claim(peer.folder())
    peer.mark(peer.setup())
    return str(peer.folder())


def _claim(folder: Path) -> None:
    """Mark a folder as made for a peer; UserError when it holds something else."""
    marker = folder / "setup.json"
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise UserError(f"{folder}: is no folder; name another place in UAVBENCH_PEERS")
    if folder.is_dir() and any(folder.iterdir()) and not is_sealed(marker):
        raise UserError(f"{folder}: holds something that `uavbench peers setup` did not write; move it")
    write_text(marker, '{\n "made": "by uavbench peers setup"\n}\n', sealed=True)
