"""Sensors and winds of users: what trackers would not get, or no vehicle can fly in, is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.sensors.sensor import Table
from uavbench.trajectories.vehicle.quadrotor import Quadrotor
from uavbench.trajectories.wind.air import Air, check_air

STAMPS = np.arange(0, 1_000_000_001, 100_000_000)
VALUES = np.tile([0.5, np.nan], (len(STAMPS), 1))


@dataclass(frozen=True)
class Own:
    """A sensor that has a table."""

    table: Table
    measured: ClassVar[tuple[str, ...]] = ("a_m", "b_m")

    def measure(self, flight: Flight, obstacles: Any, rng: np.random.Generator) -> Table:
        return self.table


class Flown:
    """All that is asked of a flight here."""

    stamps_ns = np.arange(0, 1_000_000_001, 2_000_000)


def measured(table: Table) -> Table:
    obstacles: Any = None
    flight: Any = Flown()
    return measure((Own(table),), flight, obstacles, 0)["Own"]


def test_readings_of_ones_own_are_taken_as_they_are() -> None:
    assert measured(Table(("b_m", "a_m", "true_bias_m"), STAMPS, np.ones((len(STAMPS), 3)))).columns[2] == "true_bias_m"
    assert np.isnan(measured(Table(("a_m", "b_m"), STAMPS, VALUES)).values[:, 1]).all()
    assert not len(measured(Table(("a_m", "b_m"), STAMPS[:0], VALUES[:0])).stamps_ns)
    unknown = Table(("a_m", "b_m", "true_m"), STAMPS, np.column_stack([VALUES, np.full(len(STAMPS), np.inf)]))
    assert measured(unknown) is unknown


def test_readings_that_are_for_no_tracker_are_taken_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the points that a class without `measured` sees at each stamp."""
    monkeypatch.delattr(Own, "measured")
    points = Table(("x_m",), np.repeat(STAMPS, 2), np.full((2 * len(STAMPS), 1), np.inf))
    assert measured(points) is points


@pytest.mark.parametrize(("change", "told"), [
    (lambda t: Table(t.columns, t.stamps_ns[::-1], t.values), r"row 1: the stamp 900000000 ns is not later than the"),
    (lambda t: Table(t.columns, t.stamps_ns / 1e9, t.values), r"row 1: the stamp 0 ns is not later than the one"),
    (lambda t: Table(t.columns, t.stamps_ns + 10**12, t.values), r"its stamps, 1000000000000 to .* not within the fli"),
    (lambda t: None, r"measure gives a NoneType; it takes a Table"),
    (lambda t: Table(("x", "y"), t.stamps_ns, t.values), r"its class names a_m in `measured`, and its table has x, y"),
    (lambda t: Table(t.columns, t.stamps_ns, t.values / 0.0), r"row 0: a_m is infinite; NaN where nothing was measure"),
])  # fmt: skip
def test_readings_that_no_tracker_would_get_are_told(change: Callable[[Table], Table], told: str) -> None:
    with np.errstate(divide="ignore"):
        table = change(Table(("a_m", "b_m"), STAMPS, VALUES))
    with pytest.raises(UserError, match=rf"sensors\[0\], Own: {told}"):
        measured(table)


def test_a_wind_that_is_not_there_at_each_step_is_told() -> None:
    calm, gap = np.zeros((10, 3)), np.zeros((10, 3))
    gap[4] = np.nan
    kind: Any = Flown()
    check_air(kind, Air(calm, calm), 10)
    nothing: Any = None
    with pytest.raises(UserError, match=r"wind Flown: start gives a NoneType; it takes an Air"):
        check_air(kind, nothing, 10)
    with pytest.raises(UserError, match=r"wind Flown: turbulence_m_s is not finite at step 4"):
        check_air(kind, Air(calm, gap), 10)
    with pytest.raises(UserError, match=r"wind Flown: mean_m_s has the shape \(10, 3\), not \(12, 3\)"):
        check_air(kind, Air(calm, calm), 12)


def test_an_airframe_that_builds_no_text_is_told() -> None:
    nothing: Any = None
    with pytest.raises(UserError, match=r"build of an airframe gives a NoneType; it takes a text in MJCF"):
        Quadrotor.from_mjcf(nothing)
