"""Flights in closed loop with a user's sensors and latencies: what is not of the seed, or no reading, is told."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from uavbench.bench.closed_loop.latency import delay_of
from uavbench.bench.closed_loop.sensing import LiveSensor
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.record_columns import RECORD_COLUMNS

RECORD = np.zeros((11, RECORD_COLUMNS))
Read = Callable[[np.random.Generator, int], Any]


@dataclass(frozen=True)
class Own:
    """A sensor whose reader gives what a function of its generator and the number of readings gives."""

    found: Read
    rate_hz: float = 100.0
    measured: ClassVar[tuple[str, ...]] = ("a_m", "b_m")

    def measure(self, *_: Any) -> Any:
        raise NotImplementedError

    def begin(self, readings: int, obstacles: Any, rng: np.random.Generator) -> Any:
        found = self.found

        class Reads:
            def read(self, flight: Any, stamps_ns: Any) -> Any:
                return found(rng, len(stamps_ns))

        return Reads()


def readings(found: Read) -> list[Any]:
    obstacles: Any = None
    sensor = LiveSensor("own", Own(found), 11, obstacles, np.random.default_rng(0))
    return [reading.values for reading in sensor.read(RECORD, 10)]


def test_readings_of_the_generator_given_are_taken_as_they_are() -> None:
    expected = np.random.default_rng(0).random((3, 2))
    np.testing.assert_array_equal(readings(lambda rng, n: rng.random((n, 2))), expected)
    assert np.isnan(readings(lambda rng, n: np.full((n, 3), np.nan))).all()


@pytest.mark.parametrize(("found", "told"), [
    (lambda rng, n: np.random.random((n, 2)), "other readings each time; take all random numbers from the `rng`"),  # noqa: NPY002
    (lambda rng, n: np.ones((n, 1)), r"\(3, 1\); it takes numbers \(3, 2\), a row a stamp, the columns of `measured`"),
    (lambda rng, n: np.ones((1, 2)), r"\(1, 2\); it takes numbers \(3, 2\)"),
    (lambda rng, n: None, "NoneType; it takes numbers"),
    (lambda rng, n: np.full((n, 2), np.inf), "infinite numbers; NaN where nothing was measured"),
])  # fmt: skip
def test_readings_in_flight_that_cannot_be_given_are_told(found: Read, told: str) -> None:
    with pytest.raises(UserError, match=rf"sensor own: at 0\.000 s `read` of its reader gives {told}"):
        readings(found)


@dataclass(frozen=True)
class Late:
    """A latency of a function of the generator."""

    delay: Callable[[np.random.Generator], Any]
    occupies: ClassVar[bool] = False

    def delay_ns(self, took_ms: float, rng: np.random.Generator) -> Any:
        return self.delay(rng)


def test_a_latency_of_the_generator_given_is_taken_as_it_is() -> None:
    rng = np.random.default_rng(0)
    ahead = deepcopy(rng)
    for _ in range(3):
        assert delay_of(Late(lambda rng: 1e6 * rng.random()), 0.0, rng) == round(1e6 * ahead.random())


@pytest.mark.parametrize(("delay", "told"), [
    (lambda rng: np.random.random(), "delay_ns gives another delay each time; take all random numbers from"),  # noqa: NPY002
    (lambda rng: -5, "delay_ns gives -5; it takes nanoseconds, 0 or more"),
    (lambda rng: float("nan"), "delay_ns gives nan; it takes nanoseconds"),
    (lambda rng: None, "delay_ns gives None; it takes nanoseconds"),
])  # fmt: skip
def test_a_latency_that_is_no_time_is_told(delay: Callable[[np.random.Generator], Any], told: str) -> None:
    with pytest.raises(UserError, match=f"latency .*:Late: {told}"):
        delay_of(Late(delay), 0.0, np.random.default_rng(0))


def test_a_latency_that_does_not_tell_whether_it_occupies_the_tracker_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(Late, "occupies")
    with pytest.raises(UserError, match=r"latency .*:Late: needs `occupies: ClassVar\[bool\]`"):
        delay_of(Late(lambda rng: 5), 0.0, np.random.default_rng(0))
