"""Every peer by its name: set up, present or absent."""

from collections.abc import Iterator, Mapping

from bench.peers.opencv_rapid import OpencvRapid
from bench.peers.peer import Peer
from bench.peers.visp import Visp
from tracker.base import Tracker
from trajectories.errors import unknown_name

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
    peer.mark(peer.setup())
    return str(peer.folder())
