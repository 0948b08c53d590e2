"""A flight: its specification, and its simulation."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Interval

from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.own_path import plan
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.paths.reference import Guidance, Planned, Replay
from uavbench.trajectories.paths.registry import PATHS, PathSpec
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.simulation.checks import check_camera, check_plan, check_saturation, crash_error, crash_step
from uavbench.trajectories.simulation.simulate import Simulation, simulate
from uavbench.trajectories.vehicle.airframes import Crazyflie
from uavbench.trajectories.vehicle.geometric_control import Geometric
from uavbench.trajectories.vehicle.quadrotor import STEP_NS, STEP_S, Quadrotor
from uavbench.trajectories.vehicle.registry import AirframeSpec, vehicle_of
from uavbench.trajectories.wind.winds import Still, WindSpec, air_of

__all__ = ["Flight", "FlightSpec", "fly", "path_name"]


@dataclass(frozen=True)
class FlightSpec:
    """A flight: path, vehicle, controller, wind, and requirements.

    A plan must keep clearance_m between the vehicle's bounding sphere and all obstacles. Motors may saturate for
    saturation_share of the time. A crash is an error, or, with on_crash "record", ends the record.
    """

    path: PathSpec = field(default_factory=HandPilot)
    airframe: AirframeSpec = field(default_factory=Crazyflie)
    control: Geometric = field(default_factory=Geometric)
    wind: WindSpec = field(default_factory=Still)
    clearance_m: Annotated[float, Ge(0)] = 0.1
    saturation_share: Annotated[float, Interval(ge=0, le=1)] = 0.05
    on_crash: Literal["error", "record"] = "error"


def fly(spec: FlightSpec, mount: Mount, obstacles: ObstacleMesh, seed: int) -> Flight:
    """Fly a path and return its true record; the same arguments give the same bytes.

    The record begins after a warm-up of some seconds. UserError for a path without clearance or beyond the available
    thrust, a crash, saturated motors, or a camera inside the structure.
    """
    vehicle = vehicle_of(spec.airframe, mount)
    with _told_with_path(spec):
        guidance = plan(spec.path, obstacles, mount, stream(seed, "path"))
        if isinstance(guidance, Replay):
            if spec.wind != Still():
                raise UserError("a recorded motion is replayed as it is, and no wind moves it; leave out `wind`")
            _refuse_given(
                spec, ("control", "clearance_m", "saturation_share"), "a recorded motion is replayed as it is"
            )
            return _checked(guidance.record, None, spec, mount, obstacles, vehicle)
        return _simulated(_begin(spec, guidance, vehicle, obstacles, seed), spec, mount, obstacles, vehicle)


def fly_through(simulation: Simulation, spec: FlightSpec, mount: Mount, obstacles: ObstacleMesh) -> Flight:
    """Flight of a simulation from `begin`, flown to its end on the true state; UserError as `fly`."""
    vehicle = vehicle_of(spec.airframe, mount)
    with _told_with_path(spec):
        return _simulated(simulation, spec, mount, obstacles, vehicle)


@contextmanager
def _told_with_path(spec: FlightSpec) -> Iterator[None]:
    """Prefix a UserError with the name of the path."""
    try:
        yield
    except UserError as error:
        raise UserError(f"path {path_name(spec.path)}: {error}") from None


def _simulated(
    simulation: Simulation, spec: FlightSpec, mount: Mount, obstacles: ObstacleMesh, vehicle: Quadrotor
) -> Flight:
    return _checked(simulate(simulation), simulation.reference, spec, mount, obstacles, vehicle)


def _checked(
    record: Array,
    reference: Array | None,
    spec: FlightSpec,
    mount: Mount,
    obstacles: ObstacleMesh,
    vehicle: Quadrotor,
) -> Flight:
    """The flight of a record (n, 30), up to its crash; UserError as `fly`. reference (n, 17): None of a replay."""
    step = crash_step(record, vehicle, obstacles)
    if step == 0 or (step is not None and spec.on_crash == "error"):
        raise crash_error(record, step, obstacles, None if reference is None else reference[step, :3])
    whole = record[: None if step is None else step + 1]
    whole = whole[np.isfinite(whole).all(axis=1)]
    check_camera(whole[:, RECORD["positions_m"]], whole[:, RECORD["quaternions_wxyz"]], mount, obstacles)
    if step is None and reference is not None:
        check_saturation(whole, vehicle, spec.saturation_share)
    return _flight(whole, crashed=step is not None)


def begin(
    spec: FlightSpec,
    mount: Mount,
    obstacles: ObstacleMesh,
    seed: int,
    guide: Callable[[Guidance], Guidance] | None = None,
) -> Simulation:
    """Simulation of a flight at its start, to be advanced step by step.

    guide: wraps the guidance of the path. UserError for a path without clearance or beyond the available thrust, and
    for a recorded motion.
    """
    with _told_with_path(spec):
        guidance = plan(spec.path, obstacles, mount, stream(seed, "path"))
        if isinstance(guidance, Replay):
            raise UserError("a recorded motion cannot be flown; choose a planned path")
    vehicle = vehicle_of(spec.airframe, mount)
    return _begin(spec, guidance, vehicle, obstacles, seed, guide)


def _begin(
    spec: FlightSpec,
    guidance: Guidance,
    vehicle: Quadrotor,
    obstacles: ObstacleMesh,
    seed: int,
    guide: Callable[[Guidance], Guidance] | None = None,
) -> Simulation:
    steps = guidance.warm_up + guidance.steps
    air = air_of(spec.wind, steps, STEP_S, stream(seed, "wind"))
    if isinstance(guidance, Planned):
        check_plan(guidance, vehicle, obstacles, air.mean_m_s[guidance.warm_up :], spec.clearance_m)
    else:
        _refuse_given(spec, ("clearance_m",), "this path is decided in flight, so there is no plan to be checked")
    return Simulation(vehicle, spec.control.gains(), guide(guidance) if guide else guidance, air, obstacles)


def _refuse_given(spec: FlightSpec, keys: tuple[str, ...], why: str) -> None:
    """UserError for the first of the keys that is not its default, and has no effect."""
    for key in keys:
        if getattr(spec, key) != getattr(FlightSpec(), key):
            raise UserError(f"flight.{key} has no effect: {why}; leave it out")


def _flight(record: Array, crashed: bool) -> Flight:
    return Flight(
        stamps_ns=np.arange(len(record), dtype=np.int64) * STEP_NS,
        **{name: record[:, columns] for name, columns in RECORD.items()},
        status="crashed" if crashed else "completed",
        crashed_ns=(len(record) - 1) * STEP_NS if crashed else None,
    )


def path_name(path: PathSpec) -> str:
    """Name of a path in PATHS, else that of its class."""
    return next((name for name, kind in PATHS.items() if type(path) is kind), type(path).__name__)
