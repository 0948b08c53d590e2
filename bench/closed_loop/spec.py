"""The table `[loop]` of a suite: what the vehicle flies on, and when a flight is over; and who flies."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Interval

from uavbench.bench.closed_loop.latency import LATENCIES, Constant, LatencySpec
from uavbench.scenes.dataset.spec_record import described
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.run import KNOWN
from uavbench.trajectories.errors import UserError

CAMERA = "camera"
"""Name of the tracker's poses among the filter's sensors."""


@dataclass(frozen=True, kw_only=True)
class FilterSpec:
    """What the vehicle's filter assumes beside the data sheets of the sensors.

    camera_slow_share is the part of a pose's claimed covariance that is a slow error with the time constant
    camera_slow_s; camera_bias_m and camera_bias_deg are the standard deviations of what no tracker sees in its images,
    the tolerances of the structure and of the camera's mount; gate, doubt_after and history_s as in
    `uavbench.tracker.fusion`. imu_scale multiplies the noise
    densities of the IMU's data sheet. start_* are the standard deviations of what is known at the start.
    unclaimed_m and unclaimed_deg are those of a pose whose tracker claims no covariance.
    """

    camera_slow_share: Annotated[float, Interval(ge=0, lt=1)] = 0.7
    camera_slow_s: Annotated[float, Gt(0)] = 2.0
    camera_bias_m: Annotated[float, Ge(0)] = 0.0002
    camera_bias_deg: Annotated[float, Ge(0)] = 0.005
    gate: Annotated[float, Gt(0), Interval(lt=1)] = 0.999
    doubt_after: Annotated[int, Ge(1)] = 5
    history_s: Annotated[float, Gt(0)] = 2.0
    imu_scale: Annotated[float, Gt(0)] = 1.0
    start_m: Annotated[float, Gt(0)] = 0.02
    start_deg: Annotated[float, Gt(0)] = 1.0
    start_m_s: Annotated[float, Gt(0)] = 0.2
    unclaimed_m: Annotated[float, Gt(0)] = 0.02
    unclaimed_deg: Annotated[float, Gt(0)] = 1.0


@dataclass(frozen=True, kw_only=True)
class CrashSpec:
    """What counts as a crash: the vehicle's sphere closer than clearance_m to structure or floor, or tilted further.

    A vehicle further than stray_m from its path is given up; that is no success either.
    """

    clearance_m: Annotated[float, Ge(0)] = 0.0
    tilt_deg: Annotated[float, Interval(gt=0, le=180)] = 90.0
    stray_m: Annotated[float, Gt(0)] = 5.0


@dataclass(frozen=True, kw_only=True)
class LoopSpec:
    """How the sequences of a suite are flown.

    estimator: `filter` gives guidance and controller the filter's estimate, `camera` the tracker's poses as they are,
    carried on from one to the next, `truth` the true state. sensors: those that
    the filter takes, by name (`imu`, `gnss`, `baro`, `flow`, and `camera`, the tracker's poses); by default the camera
    and all that the sequence has. prior: trackers that have `predict` are told what the filter
    expects of each frame. gnss_outages_s: spans of time without GNSS whatever the sky. corridor_m: how far
    from its path a flight may ever be to count as a success. time_limit_s ends a flight that takes longer. on_fault: a
    tracker's fault makes its frame `lost`, or ends the flight. coverage_px_m: pixels per metre of surface from which
    on it counts as inspected.
    """

    estimator: Literal["filter", "camera", "truth"] = "filter"
    sensors: tuple[str, ...] | None = None
    prior: bool = True
    latency: LatencySpec = field(default_factory=Constant)
    gnss_outages_s: tuple[tuple[float, float], ...] = ()
    filter: FilterSpec = field(default_factory=FilterSpec)
    crash: CrashSpec = field(default_factory=CrashSpec)
    corridor_m: Annotated[float, Gt(0)] = 0.5
    time_limit_s: Annotated[float, Gt(0)] | None = None
    on_fault: Literal["lost", "end"] = "lost"
    coverage_px_m: Annotated[float, Gt(0)] = 100.0

    def __post_init__(self) -> None:
        for first, last in self.gnss_outages_s:
            if not 0 <= first < last:
                raise UserError(f"gnss_outages_s: [{first:g}, {last:g}] is no span of time: from a time to a later one")
        if self.sensors is not None and len(set(self.sensors)) < len(self.sensors):
            raise UserError(f"sensors: {list(self.sensors)} names one twice")


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """A tracker by its label, at a rate, from an initial pose, in a loop; `variant` is its name among several."""

    label: str
    tracker: Tracker
    rate_hz: float
    loop: LoopSpec
    start: Initialization = KNOWN
    variant: str = ""

    @property
    def run(self) -> str:
        """Name of its flights: `robust@15hz`, and `robust@15hz+camera` in one of several loops."""
        return f"{self.label}@{self.rate_hz:g}hz{self.variant and '+'}{self.variant}"

    def described_loop(self) -> dict[str, Any]:
        """The table `[loop]` as JSON."""
        table: dict[str, Any] = described(self.loop)
        kind = next((name for name, cls in LATENCIES.items() if type(self.loop.latency) is cls), "")
        return {**table, "latency": {"kind": kind, **table["latency"]}}
