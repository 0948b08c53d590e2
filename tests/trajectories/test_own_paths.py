"""Paths of users: a plan that no vehicle can follow, or a record that is no one motion, is told by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.own_path import plan
from uavbench.trajectories.paths.recorded import resampled
from uavbench.trajectories.paths.reference import Planned, Replay, VehicleState, planned
from uavbench.trajectories.pose import Array
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.record_columns import RECORD
from uavbench.trajectories.simulation.flight import FlightSpec, begin, fly
from uavbench.trajectories.simulation.summary import planned_summary
from uavbench.trajectories.trajectory import Trajectory
from uavbench.trajectories.vehicle.quadrotor import STEP_S

T = np.arange(0.0, 1.001, 0.05)
ROLL, YAW = 0.5 * np.sin(3 * T), np.pi + 0.3 * np.sin(T)
TURNS = np.column_stack([np.cos(YAW / 2) * np.cos(ROLL / 2), np.cos(YAW / 2) * np.sin(ROLL / 2),
                         np.sin(YAW / 2) * np.sin(ROLL / 2), np.sin(YAW / 2) * np.cos(ROLL / 2)])  # fmt: skip
FLOWN = Trajectory((T * 1e9).astype(np.int64), np.column_stack([2 + 0 * T, 0.5 * np.sin(2 * T), 1 + 0 * T]), TURNS)
RECORDED = resampled(FLOWN)
PLAN = planned(RECORDED[:, :3], np.full(len(RECORDED), np.pi))


@dataclass(frozen=True)
class Own:
    """A path that plans what it was given."""

    found: Any

    def plan(self, obstacles: Any, mount: Any, rng: np.random.Generator) -> Any:
        return self.found


def changed(table: Array, columns: Any, change: Callable[[Array], Any]) -> Array:
    out = table.copy()
    out[:, columns] = change(out[:, columns])
    return out


def test_one_motion_is_flown_as_it_is() -> None:
    flight = fly(FlightSpec(path=Own(Replay(RECORDED))), Mount(), BOX, 0)
    np.testing.assert_array_equal(flight.positions_m, RECORDED[:, :3])
    assert planned_summary(FlightSpec(path=Own(PLAN)), Mount(), BOX, 0).duration_s == pytest.approx(1.0)


@dataclass(frozen=True)
class Random:
    """A path whose distance is drawn from the generator given to it, or from numpy's global one."""

    given: bool

    def plan(self, obstacles: Any, mount: Any, rng: np.random.Generator) -> Any:
        shift = rng.random() if self.given else np.random.random()  # noqa: NPY002
        return planned(RECORDED[:, :3] + [shift, 0, 0], np.full(len(RECORDED), np.pi))


def test_a_plan_that_differs_between_two_calls_is_told_and_one_of_the_given_generator_is_not() -> None:
    with pytest.raises(UserError, match="plan gives another plan each time; take all random numbers from the `rng`"):
        fly(FlightSpec(path=Random(given=False)), Mount(), BOX, 0)
    first, again = (fly(FlightSpec(path=Random(given=True)), Mount(), BOX, 3) for _ in range(2))
    np.testing.assert_array_equal(first.positions_m, again.positions_m)
    assert first.positions_m[0, 0] - 2.0 == pytest.approx(stream(3, "path").random(), abs=0.05)


@dataclass
class Stepwise:
    """Guidance step by step whose start, or later rows, are shifted by a number."""

    at: float
    later: float
    warm_up: int = 500
    steps: int = 501

    def rows(self, first: int, count: int, state: VehicleState | None) -> Array:
        out = np.repeat(PLAN.table[:1], count, axis=0)
        out[:, 3:9] = out[:, 10:] = 0.0
        out[:, 0] += self.at if state is None else self.at + self.later
        return out


@dataclass(frozen=True)
class RandomSteps:
    """A path that guides step by step; one of its numbers is drawn from numpy's global generator."""

    fickle: str

    def plan(self, obstacles: Any, mount: Any, rng: np.random.Generator) -> Any:
        drawn = 1e-3 * (np.random.random() if self.fickle else rng.random())  # noqa: NPY002
        return Stepwise(drawn, 0.0) if self.fickle == "at" else Stepwise(0.0, drawn)


@pytest.mark.parametrize("fickle", ["at", "later"])
def test_guidance_step_by_step_that_differs_between_two_plans_is_told(fickle: str) -> None:
    with pytest.raises(UserError, match="path RandomSteps: plan gives another plan each time"):
        fly(FlightSpec(path=RandomSteps(fickle)), Mount(), BOX, 0)


def test_guidance_step_by_step_of_the_given_generator_is_flown() -> None:
    assert fly(FlightSpec(path=RandomSteps("")), Mount(), BOX, 0).status == "completed"


def test_guidance_that_becomes_random_in_flight_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = Stepwise.rows

    def late(self: Stepwise, first: int, count: int, state: VehicleState | None) -> Array:
        return rows(self, first, count, state) + (1e-4 * np.random.random() if first >= 250 else 0)  # noqa: NPY002

    monkeypatch.setattr(Stepwise, "rows", late)
    with pytest.raises(
        UserError, match=r"path RandomSteps: rows of its plan gives others each time, at 0\.500 s; take"
    ):
        fly(FlightSpec(path=RandomSteps("")), Mount(), BOX, 0)


def test_guidance_whose_rows_are_not_those_of_the_controller_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Stepwise, "rows", lambda self, first, count, state: PLAN.table[:count, :10])
    with pytest.raises(UserError, match=r"path RandomSteps: rows of its plan gives \(1, 10\).*\(1, 17\)"):
        fly(FlightSpec(path=RandomSteps("")), Mount(), BOX, 0)


def test_a_log_interpolated_between_its_poses_is_one_motion() -> None:
    """Velocities and accelerations are central differences, smoother than those from row to row."""
    t = np.arange(len(RECORDED)) * STEP_S
    record = RECORDED.copy()
    log = np.arange(0.0, t[-1] + 0.01, 0.02)
    record[:, :3] = np.column_stack([np.interp(t, log, np.interp(log, t, axis)) for axis in RECORDED[:, :3].T])
    record[:, 7:10] = np.gradient(record[:, :3], STEP_S, axis=0)
    record[:, 10:13] = np.gradient(record[:, 7:10], STEP_S, axis=0)
    np.testing.assert_array_equal(plan(Own(Replay(record)), BOX, Mount(), np.random.default_rng(0)).record, record)


def test_a_plan_may_turn_many_times() -> None:
    turns = np.linspace(0, 20 * 2 * np.pi, round(150 / STEP_S))
    table = np.zeros((len(turns), PLAN.table.shape[1]))
    table[:, 9] = turns
    assert plan(Own(Planned(table)), BOX, Mount(), np.random.default_rng(0)).table is table


ZERO = np.zeros_like


@pytest.mark.parametrize(("found", "told"), [
    (None, "plan gives a NoneType; it takes a Planned, a Replay, or an object with"),
    (RECORDED, "plan gives a ndarray; it takes a Planned"),
    (iter([(1, 2)]), "plan gives a .*iterator; it takes a Planned"),
    (Planned(RECORDED[:, :3]), r"the table of Planned is .501, 3.; it takes .n, 17., n at least 2"),
    (Planned(PLAN.table[:1]), r"the table of Planned is .1, 17.; it takes"),
    (Planned(changed(PLAN.table, 9, lambda yaw: np.where(yaw > 0, np.nan, yaw))), "Planned is not finite at row 0"),
    (Planned(changed(PLAN.table, 9, np.degrees)), "its yaw reaches 180 rad; a plan has radians"),
    (Planned(changed(PLAN.table, 9, lambda yaw: np.linspace(0, 359, len(yaw)))), "its yaw reaches 359 rad; a plan"),
    (Replay(RECORDED[:, :13]), r"the record of Replay is .501, 13.; it takes .n, 30."),
    (Replay(changed(RECORDED, RECORD["positions_m"], lambda p: p * np.nan)), "Replay is not finite at row 0, 0.000 s"),
    (Replay(changed(RECORDED, RECORD["quaternions_wxyz"], lambda q: 2 * q)), "the quaternion of row 0, .* unit norm"),
    (Replay(changed(RECORDED, RECORD["velocities_m_s"], ZERO)), "velocities_m_s of its record are not the derivatives"),
    (Replay(changed(RECORDED, RECORD["positions_m"], lambda p: p * 1000)), "derivatives of its positions"),
    (Replay(changed(RECORDED, RECORD["accelerations_m_s2"], ZERO)), "accelerations_m_s2 of its record are not the der"),
    (Replay(changed(RECORDED, RECORD["angular_velocities_rad_s"], ZERO)), "angular_velocities_rad_s of its record are"),
    (Replay(changed(RECORDED, RECORD["angular_velocities_rad_s"], np.degrees)), "derivatives of its quaternions"),
])  # fmt: skip
def test_what_is_no_motion_is_told_with_the_name_of_the_path(found: Any, told: str) -> None:
    spec = FlightSpec(path=Own(found))
    for begins in (fly, begin):
        with pytest.raises(UserError, match=f"path Own: .*{told}"):
            begins(spec, Mount(), BOX, 0)
    with pytest.raises(UserError, match=told):
        planned_summary(spec, Mount(), BOX, 0)
