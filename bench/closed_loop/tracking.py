"""The tracker in flight: its faults lose frames and are logged with their stamps, but never stop the vehicle."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import NamedTuple

from uavbench.bench.closed_loop.trackers import GroundTruth
from uavbench.bench.external.program import StreamRun
from uavbench.bench.external.rows import ROW_FAULTS, TrackerFault
from uavbench.scenes.dataset.body import Samples
from uavbench.tracker.protocol import Image, Prediction, Run, TrackResult
from uavbench.tracker.run import track_frame
from uavbench.trajectories.pose import Pose

LOST = TrackResult(status="lost")


class TimedFault(NamedTuple):
    """A fault of a tracker, and the stamp of its frame in ns."""

    stamp_ns: int
    what: str


class TrackerInFlight:
    """A run of a tracker; `faults`: its faults with the stamps of their frames.

    Surplus output of a program is discarded; a program that is out of sync, so that its answers cannot be assigned to
    frames, gets no further frames.
    """

    def __init__(self, run: "Run | GroundTruth") -> None:
        self._run = run
        self.has_ended = False
        self.faults: list[TimedFault] = []

    def track(
        self,
        image: Image,
        stamp_ns: int,
        samples: Mapping[str, Samples],
        expected: Prediction | None,
        true_cam_from_world: Pose,
    ) -> TrackResult:
        """Result of a frame, `lost` without one; only the tracker `truth` gets the true pose."""
        if isinstance(self._run, GroundTruth):
            return self._run.answer(true_cam_from_world)
        if self.has_ended:
            return LOST
        result, error = track_frame(Watched(self._run, self), image, stamp_ns, samples, expected)
        if error:
            self.faults.append(TimedFault(stamp_ns, error))
        return result


class Watched:
    """A run that records when its program gets out of sync with the frames."""

    def __init__(self, run: Run, noted: TrackerInFlight) -> None:
        self._run, self._noted = run, noted
        for optional in ("sense", "predict"):
            if hasattr(run, optional):
                setattr(self, optional, getattr(run, optional))

    @property
    def track(self) -> Callable[[Image, int], TrackResult]:
        """As the run's own method, whose place in the tracker's code is told with a fault."""
        return wraps(self._run.track)(lambda image, stamp_ns: self._track(image, stamp_ns))

    def _track(self, image: Image, stamp_ns: int) -> TrackResult:
        """The run's result."""
        try:
            return self._run.track(image, stamp_ns)
        except TrackerFault as error:
            if isinstance(self._run, StreamRun) and not self._run.owes:
                self._run.process.discard()
            else:
                self._noted.has_ended |= error.fault.name not in ROW_FAULTS
            raise
