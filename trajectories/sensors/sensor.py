"""Interface of body sensors: parameters, and `measure`, from a flight to a table of measurements."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from uavbench.trajectories.errors import UserError
from uavbench.trajectories.files.writing import full_disk_told, new_file, write_text
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.pose import Array, read_only

if TYPE_CHECKING:
    from uavbench.trajectories.obstacles import ObstacleMesh


COLUMN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Name of a column, which a CSV file and an array of records can have."""


@dataclass(frozen=True, eq=False)
class Table:
    """Measurements: stamps_ns (n,) int64, `columns` named with their units, values (n, k); NaN where there is none."""

    columns: tuple[str, ...]
    stamps_ns: NDArray[np.int64]
    values: Array

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_ns, dtype=np.int64)
        stamps.setflags(write=False)
        object.__setattr__(self, "stamps_ns", stamps)
        object.__setattr__(self, "values", read_only(self.values, (len(stamps), len(self.columns))))

    def column(self, name: str) -> Array:
        """One column (n,) by its name."""
        return self.values[:, self.columns.index(name)]


class SensorSpec(Protocol):
    """A body sensor: a frozen dataclass of its parameters.

    Trackers receive only the columns of its table that the class names in `measured`, a tuple of names, and none
    without this attribute: true values such as a bias are not among them. A class with `binary = True` has too many
    readings for a CSV file: they are written as an array, and the true values as another one.
    """

    def measure(self, flight: Flight, obstacles: "ObstacleMesh", rng: np.random.Generator) -> Table:
        """Measurements along a flight; the same rng gives the same table."""
        ...


class LiveSensorSpec(SensorSpec, Protocol):
    """A body sensor that can also be read in flight (causally)."""

    @property
    def rate_hz(self) -> float:
        """Readings per second."""
        ...

    def begin(self, readings: int, obstacles: "ObstacleMesh", rng: np.random.Generator) -> "Reader":
        """Reader of the sensor in flight; its readings equal those of `measure` with the same rng."""
        ...


class Reader(Protocol):
    """Reads a body sensor in flight."""

    def read(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """The next readings (n, k), at these stamps; the first columns are those of `measured`, in their order.

        The flight is a part of the whole one, from the row at or before the last reading's stamp to the row at or after
        the last of these.
        """
        ...


class RowByRow:
    """Reader of a memoryless sensor: each reading depends on its own time and row of noise (n, m) only."""

    def __init__(self, noise: Array, readings: Callable[[Flight, NDArray[np.int64], Array], Array]) -> None:
        self._noise, self._readings, self._done = noise, readings, 0

    def read(self, flight: Flight, stamps_ns: NDArray[np.int64]) -> Array:
        """The next readings (n, k)."""
        first, self._done = self._done, self._done + len(stamps_ns)
        return self._readings(flight, stamps_ns, self._noise[first : self._done])


def sample_stamps(flight: Flight, rate_hz: float, what: str = "reading") -> NDArray[np.int64]:
    """Stamps (n,) of a sensor at rate_hz from the flight's first row to its last, to the nearest nanosecond each.

    UserError as `check_rate`.
    """
    first, last = int(flight.stamps_ns[0]), int(flight.stamps_ns[-1])
    check_rate(rate_hz, last - first, what)
    return stamps_between(first, last, rate_hz)


def check_rate(rate_hz: float, flown_ns: int, what: str = "reading", key: str = "rate_hz") -> None:
    """UserError for a rate that is not positive, or at which a flight of a duration in ns contains only its first one.

    what: what is taken at the rate; key: its name in the suite. A flight of a single row (0 ns) has one of everything.
    """
    if not 0 < rate_hz < math.inf:
        raise UserError(f"{key} {rate_hz:g}: is not a positive number; give the {what}s per second")
    if 0 < flown_ns < Fraction(10**9) / Fraction(str(rate_hz)):
        raise UserError(
            f"{key} {rate_hz:g}: one {what} takes {1 / rate_hz:g} s, and the flight {flown_ns / 1e9:g} s; raise "
            f"{key.rpartition('.')[2]}, or fly longer"
        )


def check_limits(least_range_m: float, greatest_range_m: float) -> None:
    """ValueError for ranges, metres, between which nothing is measured."""
    if least_range_m >= greatest_range_m:
        raise ValueError(
            f"least_range_m {least_range_m:g} is not below greatest_range_m {greatest_range_m:g}; swap or change them"
        )


def stamps_between(first: int, last: int, rate_hz: float) -> NDArray[np.int64]:
    """Stamps (n,) of a sensor at rate_hz from one time in ns to another, to the nearest nanosecond each."""
    period = Fraction(10**9) / Fraction(str(rate_hz))
    p, q = period.numerator, period.denominator
    return np.array([first + (2 * i * p + q) // (2 * q) for i in range((last - first) * q // p + 1)], dtype=np.int64)


def sampled(flight: Flight, values: Array, stamps_ns: NDArray[np.int64]) -> Array:
    """Values (n, k) at stamps (m,): of the row where there is one, else linear between the rows 2 ms apart."""
    if len(stamps_ns) == 1:  # in flight: the same without one-element arrays
        return _sampled_once(flight, values, int(stamps_ns[0]))
    row = np.clip(np.searchsorted(flight.stamps_ns, stamps_ns, side="right") - 1, 0, max(len(flight) - 2, 0))
    after = np.minimum(row + 1, len(flight) - 1)
    step = np.maximum(flight.stamps_ns[after] - flight.stamps_ns[row], 1)
    share = ((stamps_ns - flight.stamps_ns[row]) / step)[:, None]
    with np.errstate(invalid="ignore"):  # infinite ranges times 0
        mixed = np.where(share == 0, values[row], (1 - share) * values[row] + share * values[after])
    return np.where(share == 1, values[after], mixed)


def _sampled_once(flight: Flight, values: Array, stamp_ns: int) -> Array:
    stamps = flight.stamps_ns
    row = min(max(int(stamps.searchsorted(stamp_ns, side="right")) - 1, 0), max(len(flight) - 2, 0))
    after = min(row + 1, len(flight) - 1)
    share = (stamp_ns - int(stamps[row])) / max(int(stamps[after] - stamps[row]), 1)
    if share in (0, 1):
        return values[[after if share else row]]
    return np.asarray((1 - share) * values[row] + share * values[after])[None]


def check_same(table: Table, again: Table) -> None:
    """UserError for a user's sensor whose second table of one flight and seed is not its first."""
    same = isinstance(again, Table) and table.columns == again.columns
    if not (same and np.array_equal(table.stamps_ns, again.stamps_ns) and alike(table.values, again.values)):
        raise UserError(
            "measure gives other readings each time; take all random numbers from the `rng` that it is given, and "
            "nothing from the clock or an earlier call"
        )


def alike(values: Array, again: Array) -> bool:
    """Whether two arrays are equal, NaN to NaN."""
    return np.array_equal(values, again, equal_nan=True)


def write_table(table: Table, path: Path) -> None:
    """Write a CSV file: stamp_ns, then the columns; numbers round-trip exactly, an empty cell is no measurement."""
    lines = [",".join(("stamp_ns", *table.columns))]
    for stamp, row in zip(table.stamps_ns.tolist(), table.values.tolist(), strict=True):
        lines.append(",".join((str(stamp), *("" if value != value else repr(value) for value in row))))
    write_text(path, "\n".join(lines) + "\n")


def write_records(table: Table, columns: tuple[str, ...], path: Path) -> None:
    """Write some columns as a numpy array of records, `stamp_ns` int64 and the columns float64; NaN: no measurement."""
    kind = np.dtype([("stamp_ns", "<i8"), *((name, "<f8") for name in columns)])
    records = np.empty(len(table.stamps_ns), dtype=kind)
    records["stamp_ns"] = table.stamps_ns
    for name in columns:
        records[name] = table.column(name)
    with new_file(path) as new, new.open("wb") as handle, full_disk_told(path):
        np.lib.format.write_array(handle, records, version=(1, 0), allow_pickle=False)


def check_table(table: Table, sensor: SensorSpec, flight: Flight) -> None:
    """UserError for readings of a user's sensor that no tracker would get, by their stamps, columns or values.

    Of values and stamps only what trackers are to get is checked: the columns that its class names in `measured`, if
    any. A sensor that finds nothing during a whole flight, as a beacon out of reach, has no readings.
    """
    if not isinstance(table, Table):
        raise UserError(f"measure gives a {type(table).__name__}; it takes a Table")
    for i, name in enumerate(table.columns):
        if not isinstance(name, str) or not COLUMN.fullmatch(name) or name in ("stamp_ns", *table.columns[:i]):
            raise UserError(
                f"its table has the column {name!r}; columns have letters, digits and _, each its own name, and "
                "stamp_ns is that of the stamps"
            )
    if isinstance(measured := getattr(sensor, "measured", ()), str):
        raise UserError(f'its class has `measured = {measured!r}`, a text; give a tuple, ("{measured}",)')
    measured, stamps = tuple(measured), table.stamps_ns
    if not measured or not len(stamps):
        return
    first, last = int(flight.stamps_ns[0]), int(flight.stamps_ns[-1])
    if (wrong := np.flatnonzero(np.diff(stamps) <= 0)).size:
        row = int(wrong[0]) + 1
        raise UserError(f"row {row}: the stamp {stamps[row]} ns is not later than the one before, {stamps[row - 1]} ns")
    if stamps[0] < first or stamps[-1] > last:
        raise UserError(
            f"its stamps, {stamps[0]} to {stamps[-1]} ns, are not within the flight, {first} to {last} ns; take those "
            "of flight.stamps_ns"
        )
    if missing := [name for name in measured if name not in table.columns]:
        raise UserError(f"its class names {missing[0]} in `measured`, and its table has {', '.join(table.columns)}")
    for name in measured:
        if (rows := np.flatnonzero(np.isinf(table.column(name)))).size:
            raise UserError(f"row {rows[0]}: {name} is infinite; NaN where nothing was measured")
