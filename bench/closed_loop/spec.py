"""The table `[loop]` of a suite: estimator, sensors, and the end of a flight; and the tracker that is flown."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Interval

from uavbench.bench.closed_loop.latency import LATENCIES, Constant, LatencySpec
from uavbench.scenes.dataset.spec_record import described
from uavbench.tracker.initialization import Initialization
from uavbench.tracker.protocol import Tracker
from uavbench.tracker.run import KNOWN
from uavbench.trajectories.errors import UserError, refuse_idle

CAMERA = "camera"
"""Name of the tracker's poses among the filter's sensors."""


@dataclass(frozen=True, kw_only=True)
class FilterSpec:
    """Assumptions of the vehicle's filter, in addition to the data sheets of the sensors.

    camera_slow_share: share of a pose's claimed covariance that is a slow error with the time constant camera_slow_s;
    camera_bias_m, camera_bias_deg: standard deviations of errors that cannot be observed in the images, due to the
    tolerances of the structure and of the camera's mounting; gate, doubt_after, history_s: as in
    `uavbench.tracker.fusion`; imu_scale: factor on the noise densities of the IMU's data sheet; start_*: standard
    deviations of the initial state; unclaimed_m, unclaimed_deg: standard deviations of a pose whose tracker claims no
    covariance.
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

    def __post_init__(self) -> None:
        refuse_idle(self, {"camera_slow_s": ("camera_slow_share",)})


@dataclass(frozen=True, kw_only=True)
class CrashSpec:
    """Conditions of a crash: the vehicle's sphere is closer than clearance_m to structure or floor, or tilted too far.

    A flight that is more than stray_m from its path is aborted, which is not a success either.
    """

    clearance_m: Annotated[float, Ge(0)] = 0.0
    tilt_deg: Annotated[float, Interval(gt=0, le=180)] = 90.0
    stray_m: Annotated[float, Gt(0)] = 5.0


@dataclass(frozen=True, kw_only=True)
class LoopSpec:
    """How the sequences of a suite are flown.

    estimator: input of guidance and controller: `filter` for the filter's estimate, `camera` for the tracker's poses,
    extrapolated between frames, `truth` for the true state. sensors: names of those that the filter uses (`imu`,
    `gnss`, `baro`, `flow`, and `camera` for the tracker's poses); by default the camera and all sensors of the
    sequence. prior: whether trackers with `predict` get the filter's predicted pose for each frame. gnss_outages_s:
    intervals without GNSS. corridor_m: largest distance from its path at which a flight counts as a success.
    time_limit_s: flights that take longer are ended. on_fault: whether a tracker's fault makes its frame `lost` or ends
    the flight. coverage_px_m: resolution in pixels per metre at which surface counts as inspected.
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
                raise UserError(f"gnss_outages_s: [{first:g}, {last:g}] is not an interval; give start and end")
        if self.sensors is not None and len(set(self.sensors)) < len(self.sensors):
            raise UserError(f"sensors: {list(self.sensors)} names a sensor twice")


@dataclass(frozen=True, kw_only=True)
class Pilot:
    """A tracker by its label, with its rate, initial pose and loop; variant: name of the loop, "" for a single one."""

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
