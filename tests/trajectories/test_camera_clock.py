"""Exposure times of cameras: whole nanoseconds of the rate, shared by all rates that have them in common."""

from fractions import Fraction

import numpy as np
import pytest

from tests.trajectories.scene import standing
from uavbench.trajectories.camera_clock import CameraClock
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.vehicle.quadrotor import STEP_NS

RATES_HZ = (1.0, 7.5, 12.5, 15.0, 24.0, 29.97, 30.0, 60.0, 144.0, 500.0)
FLIGHT = standing(4.0)


def stamps(rate_hz: float, offset_s: float = 0.0, **clock: float) -> list[int]:
    exposures = CameraClock(**clock).exposures(FLIGHT, rate_hz, np.random.default_rng(0), offset_s)
    found: list[int] = exposures.stamps_ns.tolist()
    return found


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_every_frame_is_at_its_nanosecond_of_the_rate_and_none_is_missing(rate_hz: float) -> None:
    period_ns = Fraction(10**9) / Fraction(str(rate_hz))
    found = stamps(rate_hz)
    assert all(abs(stamp - k * period_ns) <= Fraction(1, 2) for k, stamp in enumerate(found))
    assert len(found) * period_ns > FLIGHT.stamps_ns[-1] >= (len(found) - 1) * period_ns


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("other_hz", RATES_HZ)
def test_two_rates_have_their_common_times_exactly(rate_hz: float, other_hz: float) -> None:
    one, other = (Fraction(10**9) / Fraction(str(rate)) for rate in (rate_hz, other_hz))
    common = Fraction(int(np.lcm(one.numerator * other.denominator, other.numerator * one.denominator)))
    common /= one.denominator * other.denominator
    of_one, of_other = stamps(rate_hz), stamps(other_hz)
    times = range(int(FLIGHT.stamps_ns[-1] / common) + 1)
    assert [of_one[int(k * common / one)] for k in times] == [of_other[int(k * common / other)] for k in times]


def test_an_offset_and_a_shift_move_all_stamps_alike() -> None:
    even = np.array(stamps(15.0))
    assert even[:4].tolist() == [0, 66_666_667, 133_333_333, 200_000_000]
    assert stamps(15.0, offset_s=0.01) == (even[:-1] + 10_000_000).tolist()
    assert stamps(15.0, timeshift_cam_imu_s=-0.0015) == (even + 1_500_000).tolist()
    late = CameraClock(timeshift_cam_imu_s=0.0015).exposures(FLIGHT, 15.0, np.random.default_rng(0))
    assert late.stamps_ns.tolist() == even[:-1].tolist()
    assert late.times_ns.tolist() == (even[:-1] + 1_500_000).tolist()


@pytest.mark.parametrize("jitter_ms", [0.5, 2.0])
def test_jitter_has_its_standard_deviation_about_the_even_times(jitter_ms: float) -> None:
    late = np.array(stamps(50.0, jitter_ms=jitter_ms)) - stamps(50.0)
    assert late[1:-1].std() == pytest.approx(1e6 * jitter_ms, rel=0.15)  # 199 draws: 5 % at one standard deviation
    assert abs(late[1:-1].mean()) < 0.3e6 * jitter_ms


def test_jitter_leaves_frames_in_order_and_within_the_flight() -> None:
    found = np.array(stamps(15.0, jitter_ms=100.0))
    assert np.abs(found - stamps(15.0)).max() == pytest.approx(0.4e9 / 15, abs=1)
    assert (np.diff(found) > 0).all() and found[0] >= 0 and found[-1] <= FLIGHT.stamps_ns[-1]


def test_a_camera_that_exposes_after_the_flight_only_is_refused() -> None:
    with pytest.raises(UserError, match="no frame is exposed in the 4 s of the flight"):
        stamps(15.0, offset_s=4.1)
    for offset_s in (3.95, 4.0):
        with pytest.raises(UserError, match=r"1 frame is exposed in the 4 s .* leaves no time for two at rate_hz 15"):
            stamps(15.0, offset_s=offset_s)
    assert stamps(16.0, offset_s=3.9375) == [3_937_500_000, 4_000_000_000]


@pytest.mark.parametrize("clock", [{}, {"jitter_ms": 2.0}])
def test_a_rate_slower_than_the_flight_is_refused(clock: dict[str, float]) -> None:
    assert len(stamps(0.25, **clock)) == 2
    with pytest.raises(UserError, match=r"^rate_hz 0.2: one frame takes 5 s, and the flight 4 s; raise rate_hz, or"):
        stamps(0.2, **clock)


@pytest.mark.parametrize("rate_hz", [0.0, -15.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(rate_hz: float) -> None:
    with pytest.raises(UserError, match=r"^rate_hz (inf: the flight has 500 steps|.*: is not a positive number; give)"):
        stamps(rate_hz)


def test_a_rate_above_that_of_the_steps_is_refused() -> None:
    assert stamps(500.0) == [STEP_NS * k for k in range(2001)]
    with pytest.raises(UserError, match="the flight has 500 steps a second"):
        stamps(501.0)
