"""Who flies: a tracker at a rate, from a first pose, in a loop."""

from dataclasses import dataclass
from typing import Any

from uavbench.bench.closed_loop.latency import LATENCIES
from uavbench.bench.closed_loop.spec import LoopSpec
from uavbench.scenes.dataset.spec_record import described
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.run import KNOWN


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """A tracker by its label, at a rate, from a first pose, in a loop."""

    label: str
    tracker: Tracker
    rate_hz: float
    loop: LoopSpec
    start: Initialization = KNOWN

    def described_loop(self) -> dict[str, Any]:
        """The table `[loop]` as JSON."""
        table: dict[str, Any] = described(self.loop)
        kind = next((name for name, cls in LATENCIES.items() if type(self.loop.latency) is cls), "")
        return {**table, "latency": {"kind": kind, **table["latency"]}}
