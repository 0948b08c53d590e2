"""Sensors, winds and airframes of users: what trackers would not get, cannot fly, or is not of the seed, is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from tests.trajectories.scene import BOX
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.paths.around import Hover
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.registry import measure
from uavbench.trajectories.sensors.sensor import Table
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.airframes import Crazyflie
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
    (lambda t: Table(("a_m", "a_m"), t.stamps_ns, t.values), r"its table has the column 'a_m'; columns have letters"),
    (lambda t: Table(("a_m", "b, m"), t.stamps_ns, t.values), r"its table has the column 'b, m'; columns have letters"),
    (lambda t: Table(("stamp_ns", "b_m"), t.stamps_ns, t.values), r"its table has the column 'stamp_ns'; columns have"),
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


def drawn(given: bool, rng: np.random.Generator) -> float:
    """A number of the generator given to a plug-in, or of numpy's global one."""
    return float(rng.random() if given else np.random.random())  # noqa: NPY002


@dataclass(frozen=True)
class RandomSensor:
    """A sensor that measures a random number."""

    given: bool
    measured: ClassVar[tuple[str, ...]] = ("a_m",)

    def measure(self, flight: Flight, obstacles: Any, rng: np.random.Generator) -> Table:
        return Table(("a_m",), STAMPS, np.full((len(STAMPS), 1), drawn(self.given, rng)))


def test_readings_that_are_others_in_each_run_of_a_seed_are_told() -> None:
    flight: Any = Flown()
    obstacles: Any = None
    with pytest.raises(UserError, match=r"sensors\[0\], RandomSensor: measure gives other readings each time; take"):
        measure((RandomSensor(given=False),), flight, obstacles, 0)
    table = measure((RandomSensor(given=True),), flight, obstacles, 0)["RandomSensor"]
    assert table.values[0, 0] == stream(0, "sensor", "RandomSensor").random()


@dataclass(frozen=True)
class RandomWind:
    """A wind of a random speed."""

    given: bool

    def start(self, steps: int, step_s: float, rng: np.random.Generator) -> Air:
        calm = np.zeros((steps, 3))
        return Air(calm + 0.1 * drawn(self.given, rng), calm)


@dataclass(frozen=True)
class RandomAirframe:
    """A vehicle of a random mass."""

    spread: float

    def build(self, mount: Mount) -> str:
        return Crazyflie(mass_kg=0.027 + self.spread * np.random.random()).build(mount)  # noqa: NPY002


def test_a_flight_that_is_another_one_in_each_run_of_a_seed_is_told() -> None:
    hover = Hover(duration_s=0.1)
    with pytest.raises(UserError, match="wind RandomWind: start gives another mean_m_s each time; take all random"):
        fly(FlightSpec(path=hover, wind=RandomWind(given=False)), Mount(), BOX, 0)
    with pytest.raises(UserError, match=r"airframe .*:RandomAirframe: build gives another vehicle each time"):
        fly(FlightSpec(path=hover, airframe=RandomAirframe(1e-3)), Mount(), BOX, 0)
    spec = FlightSpec(path=hover, wind=RandomWind(given=True), airframe=RandomAirframe(0.0))
    assert fly(spec, Mount(), BOX, 0).winds_m_s[0, 0] == 0.1 * stream(0, "wind").random()


@pytest.mark.parametrize(("air", "told"), [
    (Air([[0.0] * 3] * 10, np.zeros((10, 3))), r"mean_m_s is a list; it takes an array of floats \(10, 3\)"),  # type: ignore[arg-type]
    (Air(np.zeros((10, 3)), np.zeros((10, 3), dtype=int)), r"turbulence_m_s is of int64; it takes an array of floats"),
    (Air(np.zeros((10, 3)), np.zeros((10, 3)), np.nan), r"near_gain nan and near_m 1.0 must be finite"),
    (Air(np.zeros((10, 3)), np.zeros((10, 3)), 1.0, 0.0), r"near_gain 1.0 and near_m 0.0 must be finite"),
])  # fmt: skip
def test_a_wind_that_cannot_be_flown_in_is_told(air: Air, told: str) -> None:
    kind: Any = Flown()
    with pytest.raises(UserError, match=f"wind Flown: {told}"):
        check_air(kind, air, 10)


@pytest.mark.parametrize(
    "name", ["flight", "frames", "groundtruth", "edges", "crlb", "gimbal", "camera", "path", "Höhe"]
)
def test_a_sensor_whose_file_would_be_another_one_is_told(name: str) -> None:
    """As that of a class `flight`, which had replaced the ground truth of the flight."""
    kind = dataclass(frozen=True)(type(name, (Own,), {}))
    flight: Any = Flown()
    obstacles: Any = None
    table = Table(("a_m", "b_m"), STAMPS, VALUES)
    with pytest.raises(UserError, match=rf"sensors\[0\], {name}: its name, .* rename the class"):
        measure((kind(table),), flight, obstacles, 0)


def test_a_text_in_place_of_the_names_of_columns_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Own, "measured", "a_m")
    with pytest.raises(UserError, match=r"its class has `measured = 'a_m'`, a text; give a tuple, \(\"a_m\",\)"):
        measured(Table(("a_m",), STAMPS, VALUES[:, :1]))
