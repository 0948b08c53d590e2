import numpy as np
import pytest
from scipy.signal import welch

from tests.trajectories.scene import BOX
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.wind.dryden import Dryden, first_order, second_order
from uavbench.trajectories.wind.winds import WINDS, Gust, Steady, Still


def many(step_s: float, lag_s: float, kind: object) -> np.ndarray:
    """One long run cut off after enough correlation times that its sigma is known to 0.7 %."""
    steps = int(20_000 * lag_s / step_s)
    return np.asarray(kind(steps, step_s, lag_s, np.random.default_rng(1)))  # type: ignore[operator]


@pytest.mark.parametrize("step_s", [0.0005, 0.002, 0.005, 0.02])
@pytest.mark.parametrize("kind", [first_order, second_order])
def test_sigma_is_that_asked_for_at_every_step(step_s: float, kind: object) -> None:
    assert many(step_s, 0.1, kind).std() == pytest.approx(1.0, rel=0.03)


def test_the_whole_wind_has_the_sigmas_and_the_mean_of_the_specification() -> None:
    wind = Dryden(w20_m_s=6.0, height_m=6.096, flight_speed_m_s=400.0)  # carried past fast, so that a run is long
    up = 0.1 * 6.0
    level = up / (0.177 + 0.000823 * 20) ** 0.4
    np.testing.assert_allclose(wind.sigmas_m_s, [level, level, up])
    np.testing.assert_allclose(wind.lengths_m, np.array([20 / (0.177 + 0.000823 * 20) ** 1.2] * 2 + [20.0]) * 0.3048)
    assert wind.mean_m_s == pytest.approx(6.0)  # 6.096 m is the 20 ft that w20 is measured at
    for step in (0.0005, 0.02):
        air = wind.start(1_000_000, step, np.random.default_rng(0))
        np.testing.assert_allclose(air.turbulence_m_s.std(axis=0), wind.sigmas_m_s, rtol=0.03)
        np.testing.assert_array_equal(air.mean_m_s[0], [-6.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("kind", "shape"),
    [
        (first_order, lambda s: np.sqrt(2) / (1 + s)),
        (second_order, lambda s: (1 + np.sqrt(3) * s) / (1 + s) ** 2),
    ],
)
def test_the_spectrum_is_that_of_the_filter(kind: object, shape: object) -> None:
    lag, step = 0.2, 0.005
    f, density = welch(many(step, lag, kind), fs=1 / step, nperseg=4096)
    wanted = 2 * lag * np.abs(shape(2j * np.pi * f * lag)) ** 2  # type: ignore[operator]
    band = (f > 0.2) & (f < 20)  # well below the Nyquist frequency, where a sampled process folds back
    np.testing.assert_allclose(density[band], wanted[band], rtol=0.25)
    assert density[band].sum() == pytest.approx(wanted[band].sum(), rel=0.02)


def test_a_run_is_stationary_from_its_first_sample_on() -> None:
    rng = np.random.default_rng(0)
    for kind in (first_order, second_order):
        runs = np.array([kind(30, 0.02, 1.0, rng) for _ in range(8000)])
        np.testing.assert_allclose(runs[:, [0, 5, -1]].std(axis=0), 1.0, rtol=0.03)


def test_gusts_rise_and_fall_as_cosines() -> None:
    gust = Gust(speed_m_s=1.0, gust_m_s=2.0, from_deg=180.0, first_s=1.0, every_s=10.0, jitter_s=0.0)
    air = gust.start(5000, 0.002, np.random.default_rng(0))
    speed = air.mean_m_s[:, 0]
    assert speed[[0, 500]] == pytest.approx([1.0, 1.0])
    assert speed[750] == pytest.approx(2.0)  # half way up
    assert speed[[1000, 1700]] == pytest.approx([3.0, 3.0])
    assert speed[2000] == pytest.approx(2.0)  # half way down
    assert speed[2300:].max() == pytest.approx(1.0)


def test_each_axis_of_the_turbulence_has_its_own_scale_length() -> None:
    """Its correlation over a lag is exp(-1) along the wind, and exp(-1) (1 - 1/2) across it and upwards."""
    wind, step_s = Dryden(w20_m_s=6.0, height_m=30.0, flight_speed_m_s=400.0), 0.002
    turbulence = wind.start(1_000_000, step_s, np.random.default_rng(0)).turbulence_m_s
    lags = wind.lengths_m / np.hypot(wind.mean_m_s, 400.0)
    assert lags[1] > 1.3 * lags[2]
    for axis, expected in enumerate([np.exp(-1), np.exp(-1) / 2, np.exp(-1) / 2]):
        steps = round(lags[axis] / step_s)
        values = turbulence[:, axis] / wind.sigmas_m_s[axis]
        assert np.mean(values[:-steps] * values[steps:]) == pytest.approx(expected, abs=0.03), axis


def test_a_gust_that_no_flight_waits_for_is_told() -> None:
    with pytest.raises(UserError, match=r"wind gust: first_s 100: no gust comes before the end of the flight, .* 10 s"):
        Gust(first_s=100.0).start(5000, 0.002, np.random.default_rng(0))
    Gust(first_s=100.0).start(50_000, 0.002, np.random.default_rng(0))


def test_a_gust_comes_again_and_those_that_meet_are_no_stronger() -> None:
    """Every 4 s, each 3.5 s long; every 2 s, so that one rises while the last one falls."""
    gust = Gust(gust_m_s=2.0, first_s=1.0, every_s=4.0, jitter_s=0.0)
    strength = -gust.start(5000, 0.002, np.random.default_rng(0)).mean_m_s[:, 0] - 1.0
    assert strength[[1000, 3000, 500, 2500]] == pytest.approx([2.0, 2.0, 0.0, 0.0])
    np.testing.assert_allclose(strength[3000:4200], strength[1000:2200], atol=1e-12)
    dense = Gust(gust_m_s=2.0, first_s=1.0, every_s=2.5, jitter_s=0.0).start(5000, 0.002, np.random.default_rng(0))
    assert (-dense.mean_m_s[:, 0] - 1.0).max() == pytest.approx(2.0)
    assert -dense.mean_m_s[2000, 0] - 1.0 == pytest.approx(1.0, abs=1e-6)  # both half way


def test_a_wind_that_says_nothing_more_is_that_of_the_suites() -> None:
    assert Steady() == Steady(speed_m_s=2.0, from_deg=0.0)
    assert Gust() == Gust(
        speed_m_s=1.0, gust_m_s=2.0, from_deg=0.0, first_s=5.0, every_s=12.0, jitter_s=2.0, rise_s=1.0, hold_s=1.5
    )
    assert Dryden() == Dryden(w20_m_s=3.0, from_deg=0.0, height_m=3.0, flight_speed_m_s=0.5, near_gain=0.0, near_m=1.0)
    assert set(WINDS) == {"still", "steady", "gust", "dryden"}


@pytest.mark.parametrize(("height_m", "feet"), [(1.0, 10.0), (3.048, 10.0), (30.48, 100.0)])
def test_the_specification_begins_at_ten_feet_and_the_mean_grows_with_the_logarithm(
    height_m: float, feet: float
) -> None:
    wind = Dryden(w20_m_s=6.0, height_m=height_m)
    assert wind.mean_m_s == pytest.approx(6.0 * np.log(feet / 0.15) / np.log(20 / 0.15))
    level = 0.6 / (0.177 + 0.000823 * feet) ** 0.4
    np.testing.assert_allclose(wind.sigmas_m_s, [level, level, 0.6])
    level = 0.3048 * feet / (0.177 + 0.000823 * feet) ** 1.2
    np.testing.assert_allclose(wind.lengths_m, [level, level, 0.3048 * feet])


def test_turbulence_turns_with_the_wind_and_is_carried_at_the_speed_of_both() -> None:
    along, across = (
        Dryden(w20_m_s=4.0, from_deg=angle, flight_speed_m_s=3.0).start(200, 0.01, np.random.default_rng(2))
        for angle in (0.0, 90.0)
    )
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(across.turbulence_m_s, along.turbulence_m_s @ turn.T, atol=1e-12)
    np.testing.assert_allclose(across.mean_m_s, along.mean_m_s @ turn.T, atol=1e-12)
    wind = Dryden(w20_m_s=4.0, flight_speed_m_s=3.0)
    lag_s = wind.lengths_m[0] / np.hypot(wind.mean_m_s, 3.0)
    u = first_order(200, 0.01, lag_s, np.random.default_rng(2).spawn(3)[0]) * wind.sigmas_m_s[0]
    np.testing.assert_allclose(along.turbulence_m_s[:, 0], -u)  # from +x, towards -x


@pytest.mark.parametrize("name", list(WINDS))
def test_a_longer_flight_starts_with_the_same_wind_which_nobody_changes(name: str) -> None:
    short, long = (WINDS[name]().start(steps, 0.01, np.random.default_rng(3)) for steps in (800, 1000))
    for part in ("mean_m_s", "turbulence_m_s"):
        np.testing.assert_allclose(getattr(long, part)[:800], getattr(short, part), atol=1e-12)
        assert not getattr(short, part).flags.writeable
    assert short.turbulence_m_s.any() == (name == "dryden")


def test_gusts_come_early_as_often_as_late() -> None:
    gust = Gust(first_s=4.0, every_s=100.0, jitter_s=2.0)
    begins = []
    for seed in range(60):
        speed = gust.start(5000, 0.002, np.random.default_rng(seed)).mean_m_s[:, 0]
        begins.append(0.002 * np.flatnonzero(np.abs(speed) > 1.0 + 1e-6)[0])
    assert 2.0 <= min(begins) < 2.5
    assert 5.5 < max(begins) <= 6.1
    assert np.mean(begins) == pytest.approx(4.0, abs=0.5)


def test_turbulence_grows_near_the_structure() -> None:
    air = Dryden(near_gain=2.0, near_m=0.5).start(100, 0.002, np.random.default_rng(0))
    near, far = (air.at(0, 100, np.array([x, 0.0, 0.15]), BOX) - air.mean_m_s for x in (0.7, 50.0))
    np.testing.assert_allclose(near, (1 + 2 * np.exp(-1)) * air.turbulence_m_s)
    np.testing.assert_allclose(far, air.turbulence_m_s)


@pytest.mark.parametrize("name", list(WINDS))
def test_every_wind_is_finite_and_repeats_under_a_seed(name: str) -> None:
    first, second = (WINDS[name]().start(500, 0.002, stream(0, "wind")) for _ in range(2))
    assert first.mean_m_s.shape == first.turbulence_m_s.shape == (500, 3)
    assert np.isfinite(first.mean_m_s + first.turbulence_m_s).all()
    np.testing.assert_array_equal(first.mean_m_s, second.mean_m_s)
    np.testing.assert_array_equal(first.turbulence_m_s, second.turbulence_m_s)


def test_still_is_still_and_steady_blows_from_its_side() -> None:
    assert not Still().start(3, 0.002, np.random.default_rng(0)).mean_m_s.any()
    np.testing.assert_allclose(
        Steady(3.0, 90.0).start(1, 0.002, np.random.default_rng(0)).mean_m_s, [[0, -3, 0]], atol=1e-12
    )


def test_the_wind_of_a_seed_stays_what_suites_have_flown_in() -> None:
    """Its law leaves open which draw does what: as it was first."""
    drawn = [kind(4, 0.1, 0.4, np.random.default_rng(0)).tolist() for kind in (first_order, second_order)]
    assert drawn == [
        pytest.approx([0.1257302210933933, 0.01505319936241864, 0.41344222077813947, 0.38778996287648687], rel=1e-12),
        pytest.approx([0.15563732226959698, 0.5742629771009281, -0.003129269842370566, 0.9234159273733641], rel=1e-12),
    ]
