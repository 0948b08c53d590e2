"""Latency of a tracker: percentiles of wall time per frame, and deadline misses."""

from dataclasses import dataclass

import numpy as np

from uavbench.tracker.results import Results
from uavbench.trajectories.pose import Array


@dataclass(frozen=True, kw_only=True)
class Latency:
    """Percentiles of wall times in ms, over n frames."""

    p50_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float
    mean_ms: float
    n: int

    @classmethod
    def of(cls, times_ms: Array) -> "Latency | None":
        """Latency of times (n,); None without any."""
        if not len(times_ms):
            return None
        p50, p95, p99 = np.percentile(times_ms, [50, 95, 99]).tolist()
        return cls(
            p50_ms=p50, p95_ms=p95, p99_ms=p99, max_ms=float(times_ms.max()), mean_ms=float(times_ms.mean()),
            n=len(times_ms),
        )  # fmt: skip


def stage_latencies(results: Results) -> dict[str, Latency]:
    """Latency of each stage by name; `total` is the frame's."""
    names = dict.fromkeys(name for row in results.rows for name in row.stage_ms)
    table = {name: np.array([r.stage_ms[name] for r in results.rows if name in r.stage_ms]) for name in names}
    found = {name: Latency.of(times) for name, times in table.items()}
    return {name: latency for name, latency in found.items() if latency is not None}


def deadline_misses(results: Results) -> float | None:
    """Share (0 to 1) of frames that took longer than the usual interval between frames; None without times.

    That of the stamps: of frames at 15 Hz every fourth one is used where 4 Hz are asked for, 3.75 Hz.
    """
    times = np.array([row.stage_ms["total"] for row in results.rows if "total" in row.stage_ms])
    if not len(times):
        return None
    several = len(results) > 1
    interval_ms = np.median(np.diff(results.stamps_ns)) / 1e6 if several else 1e3 / float(results.record["rate_hz"])
    return float((times > interval_ms).mean())
