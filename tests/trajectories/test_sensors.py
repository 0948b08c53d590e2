import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.trajectories.scene import BOX, DECK, block, standing
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.paths.along import UndersidePass
from uavbench.trajectories.paths.around import FigureEight
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.pose import rotation_exp, rotation_from_quaternion
from uavbench.trajectories.random_streams import stream
from uavbench.trajectories.sensors.barometer import Barometer, height_at, pressure_at
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu, inertial_ground_truth
from uavbench.trajectories.sensors.optical_flow import FlowDeck, flow_ground_truth
from uavbench.trajectories.sensors.ranging import LaserRanging
from uavbench.trajectories.sensors.registry import SENSORS, flight_table, measure, write_flight
from uavbench.trajectories.sensors.satellites import sky
from uavbench.trajectories.sensors.sensor import Table, sample_stamps, sampled, write_table
from uavbench.trajectories.simulation.flight import FlightSpec, fly
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2, STEP_S

FLIGHT = fly(FlightSpec(path=HandPilot(duration_s=5.0)), Mount(), BOX, 0)


def allan(values: np.ndarray, rate_hz: float, window: int) -> float:
    """Overlapping Allan deviation of rates at an averaging time of `window` samples (IEEE 952)."""
    angle = np.concatenate([[0.0], np.cumsum(values)]) / rate_hz
    second = angle[2 * window :] - 2 * angle[window:-window] + angle[: -2 * window]
    return float(np.sqrt((second**2).mean() / 2) / (window / rate_hz))


def test_allan_deviation_recovers_noise_density_and_random_walk() -> None:
    imu = Imu(rate_hz=100.0, gyro_noise_rad_s_sqrt_hz=2e-3, gyro_walk_rad_s2_sqrt_hz=4e-4)
    flight = standing(2000.0, step_ns=10_000_000)
    table = imu.measure(flight, BOX, np.random.default_rng(0))
    for name, noise, walk, offset in (
        ("w", imu.gyro_noise_rad_s_sqrt_hz, imu.gyro_walk_rad_s2_sqrt_hz, 0.0),
        ("a", imu.accel_noise_m_s2_sqrt_hz, imu.accel_walk_m_s3_sqrt_hz, GRAVITY_M_S2),
    ):
        unit = "rad_s" if name == "w" else "m_s2"
        axes = [table.column(f"{name}{axis}_{unit}") for axis in "xyz"]
        biases = [table.column(f"{'gyro' if name == 'w' else 'accel'}_bias_{axis}_{unit}") for axis in "xyz"]
        white = [values - bias for values, bias in zip(axes, biases, strict=True)]
        assert np.mean([v.mean() for v in white]) == pytest.approx(offset / 3, abs=1e-2)
        # Density N: sigma(tau) = N / sqrt(tau). Random walk K: sigma(tau) = K sqrt(tau / 3).
        density = np.mean([allan(v, 100.0, 10) * np.sqrt(0.1) for v in white])
        rate_walk = np.mean([allan(b, 100.0, 100) / np.sqrt(1.0 / 3.0) for b in biases])
        assert density == pytest.approx(noise, rel=0.05)
        assert rate_walk == pytest.approx(walk, rel=0.05)
        # Both together, as a user sees them: the sum of their variances at every averaging time.
        for window in (10, 100, 1000):
            tau = window / 100.0
            both = np.sqrt(np.mean([allan(v, 100.0, window) ** 2 for v in axes]))
            assert both == pytest.approx(np.hypot(noise / np.sqrt(tau), walk * np.sqrt(tau / 3)), rel=0.1)


def test_a_perfect_imu_integrates_back_to_the_flight() -> None:
    flight = fly(FlightSpec(path=FigureEight(loops=1)), Mount(), BOX, 0)
    perfect = Imu(
        rate_hz=500.0,
        gyro_noise_rad_s_sqrt_hz=0.0,
        gyro_walk_rad_s2_sqrt_hz=0.0,
        accel_noise_m_s2_sqrt_hz=0.0,
        accel_walk_m_s3_sqrt_hz=0.0,
    )
    table = perfect.measure(flight, BOX, np.random.default_rng(0)).values
    R = rotation_from_quaternion(flight.quaternions_wxyz[0])
    p, v = flight.positions_m[0].copy(), flight.velocities_m_s[0].copy()
    for k in range(5000):
        middle = R @ rotation_exp(0.5 * STEP_S * 0.5 * (table[k, 0:3] + table[k + 1, 0:3]))
        a = middle @ (0.5 * (table[k, 3:6] + table[k + 1, 3:6])) - [0, 0, GRAVITY_M_S2]
        p += STEP_S * v + 0.5 * STEP_S**2 * a
        v += STEP_S * a
        R = R @ rotation_exp(STEP_S * 0.5 * (table[k, 0:3] + table[k + 1, 0:3]))
    np.testing.assert_allclose(p, flight.positions_m[5000], atol=5e-3)
    np.testing.assert_allclose(R, rotation_from_quaternion(flight.quaternions_wxyz[5000]), atol=1e-4)


def test_an_imu_off_centre_feels_the_turning() -> None:
    offset = np.array([0.3, -0.1, 0.05])
    spun = replace(
        standing(1.0),
        angular_velocities_rad_s=np.tile([0.0, 0.0, 2.0], (501, 1)),
        angular_accelerations_rad_s2=np.tile([0.0, 0.0, 5.0], (501, 1)),
    )
    _, force = inertial_ground_truth(spun, offset)
    expected = [-4.0 * 0.3 + 5.0 * 0.1, 4.0 * 0.1 + 5.0 * 0.3, GRAVITY_M_S2]
    np.testing.assert_allclose(force, np.tile(expected, (501, 1)), atol=1e-12)
    clipped = Imu(accel_range_m_s2=5.0).measure(spun, BOX, np.random.default_rng(0))
    assert np.abs(clipped.values[:, 3:6]).max() <= 5.0


def test_flow_gathers_to_the_way_flown_over_the_range() -> None:
    n = 2001
    moving = replace(
        standing(4.0, height=0.8),
        positions_m=np.column_stack([5 + 0.25 * np.arange(n) * STEP_S, np.zeros(n), np.full(n, 0.8)]),
        velocities_m_s=np.tile([0.25, 0.0, 0.0], (n, 1)),
    )
    deck = FlowDeck(flow_noise_px=0.0)
    table = deck.measure(moving, BOX, np.random.default_rng(0))
    counted = table.column("dx_px").sum() * 0.71674 / 35.0
    assert counted == pytest.approx(0.25 * 4.0 / 0.8, rel=0.02)
    noisy = FlowDeck(flow_noise_px=0.5).measure(moving, BOX, np.random.default_rng(0))
    assert noisy.column("dx_px").mean() == pytest.approx(35.0 / 0.71674 * 0.25 / 0.8 / 50.0, abs=0.15)
    assert np.nanmean(table.column("range_m")) == pytest.approx(0.8, abs=1e-3)
    turning = replace(standing(1.0, 0.8), angular_velocities_rad_s=np.tile([0.3, 0.2, 0.0], (501, 1)))
    flow, distance = flow_ground_truth(turning, BOX)
    np.testing.assert_allclose(flow, np.tile([-0.2, 0.3], (501, 1)), atol=1e-12)
    np.testing.assert_allclose(distance, 0.8)


def test_the_deck_ranges_to_the_structure_beneath_and_goes_blind_high_up() -> None:
    above = replace(standing(1.0), positions_m=np.tile([0.0, 0.0, 1.0], (501, 1)))
    np.testing.assert_allclose(flow_ground_truth(above, BOX)[1], 0.7)
    high = FlowDeck().measure(standing(1.0, height=5.0), BOX, np.random.default_rng(0))
    assert np.isnan(high.values).all()


def test_the_barometer_inverts_its_own_atmosphere() -> None:
    heights = np.linspace(0, 100, 50)
    np.testing.assert_allclose(height_at(pressure_at(heights, 101325.0), 101325.0), heights, atol=1e-9)
    assert (pressure_at(np.array([0.0]), 101325.0) - pressure_at(np.array([1.0]), 101325.0))[0] == pytest.approx(
        12.01, abs=0.02
    )
    quiet = Barometer(noise_pa=0.0, drift_pa=0.0).measure(standing(1.0, height=2.5), BOX, np.random.default_rng(0))
    np.testing.assert_allclose(quiet.column("height_m"), 2.5, atol=1e-6)
    loud = Barometer(drift_pa=0.0).measure(standing(100.0), BOX, np.random.default_rng(0))
    assert loud.column("pressure_pa").std() == pytest.approx(1.0, rel=0.05)


def test_the_sky_is_that_of_a_receiver_on_the_earth() -> None:
    ups = sky(np.linspace(0, 86_164, 200), 90.0)[..., 2]
    assert np.degrees(np.arcsin(ups.max())) < 55.0  # at the pole no GPS satellite climbs to the zenith
    equator = sky(np.linspace(0, 86_164, 400), 0.0)
    np.testing.assert_allclose(np.linalg.norm(equator, axis=-1), 1.0)
    assert equator[..., 2].max() > 0.99
    assert (sky(np.arange(0, 86_164, 600.0), 45.0)[..., 2] > np.sin(np.radians(10))).sum(axis=1).min() >= 4
    # After a sidereal day the satellites have gone around twice, and stand where they stood.
    np.testing.assert_allclose(sky(np.array([0.0]), 40.0), sky(np.array([86_164.0]), 40.0), atol=2e-3)


def test_gnss_degrades_and_drops_out_beneath_the_deck() -> None:
    mount = Mount(pitch_deg=60.0)
    path = UndersidePass(height_m=3.8, overrun_m=25.0, speed_m_s=3.0, acceleration_m_s2=2.0)
    flight = fly(FlightSpec(path=path, clearance_m=0.5), mount, DECK, 0)
    table = Gnss().measure(flight, DECK, np.random.default_rng(0))
    x = sampled(flight, flight.positions_m, table.stamps_ns)[:, 0]
    beneath, away = np.abs(x) < 3.0, np.abs(x) > 25.0
    fixed = np.isfinite(table.column("px_m"))
    assert not fixed[beneath].any() and fixed[away].all()
    assert table.column("satellites")[beneath].mean() < table.column("satellites")[away].mean() - 2
    where = np.column_stack([table.column(f"p{axis}_m") for axis in "xyz"])
    error = (where - sampled(flight, flight.positions_m, table.stamps_ns))[away]
    assert 0.3 < np.sqrt((error**2).sum(axis=1).mean()) < 12.0


def test_gnss_error_scales_with_the_dilution_of_precision() -> None:
    gnss = Gnss(slow_m=0.0, white_m=1.0, rate_hz=1.0)
    flight = standing(500.0, height=30.0, step_ns=100_000_000)
    table = gnss.measure(flight, BOX, np.random.default_rng(0))
    error = table.values[:, 2:5] - [5.0, 0.0, 30.0]
    assert np.sqrt((error**2).sum(axis=1).mean()) == pytest.approx(
        np.sqrt((table.column("pdop") ** 2).mean()), rel=0.05
    )
    walled = gnss.measure(flight, block((5.5, -50, 0), (6.0, 50, 80)), np.random.default_rng(0))
    assert walled.column("satellites").max() < table.column("satellites").max()


@pytest.mark.parametrize("name", [name for name in SENSORS if not issubclass(SENSORS[name], LaserRanging)])
def test_every_sensor_repeats_under_a_seed_and_keeps_its_rate(name: str) -> None:
    sensor = SENSORS[name]()
    first, second = (sensor.measure(FLIGHT, BOX, stream(3, "sensor", name)) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    steps = np.diff(first.stamps_ns)
    assert (np.abs(steps - 1e9 / sensor.rate_hz) <= 1).all()  # type: ignore[attr-defined]
    assert first.stamps_ns[0] == 0 and first.stamps_ns[-1] <= FLIGHT.stamps_ns[-1]
    assert np.isfinite(first.values).mean() > 0.99


@pytest.mark.parametrize("kind", [Imu, Barometer, Gnss, FlowDeck])
def test_more_readings_than_are_read_are_refused_before_they_take_memory(kind: type) -> None:
    with pytest.raises(UserError, match=r"sensors\[0\], \S+: at rate_hz 1e\+12 .* at most 2,000,000"):
        measure((kind(rate_hz=1e12),), standing(1.0), BOX, 0)


def test_adding_a_sensor_leaves_the_others_readings_alone() -> None:
    alone = measure((Imu(),), FLIGHT, BOX, 5)
    crowd = measure((Barometer(), Gnss(), Imu(), FlowDeck(), Imu()), FLIGHT, BOX, 5)
    assert list(crowd) == ["baro", "gnss", "imu", "flow", "imu-2"]
    np.testing.assert_array_equal(alone["imu"].values, crowd["imu"].values)
    assert not np.array_equal(crowd["imu"].values, crowd["imu-2"].values)


def test_files_read_back_exactly_and_leave_missing_readings_empty(tmp_path: Path) -> None:
    names = write_flight(FLIGHT, (Imu(), Gnss()), BOX, 0, tmp_path)
    assert names == ["flight.csv", "imu.csv", "gnss.csv"]
    with (tmp_path / "flight.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    table = flight_table(FLIGHT)
    assert [int(row["stamp_ns"]) for row in rows] == table.stamps_ns.tolist()
    assert [float(rows[7][name]) for name in table.columns] == table.values[7].tolist()
    assert len(rows) == 501 and {"px_m", "qw", "vx_m_s", "ax_m_s2", "wx_rad_s", "thrust_command_1_n"} <= set(rows[0])
    write_table(Table(("a", "b"), np.array([1, 2]), np.array([[0.1, np.nan], [np.nan, 3.0]])), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "stamp_ns,a,b\n1,0.1,\n2,,3.0\n"


def test_samples_between_rows_are_linear_and_on_rows_exact() -> None:
    ramp = FLIGHT.stamps_ns[:, None] / 1e9
    stamps = sample_stamps(FLIGHT, 200.0)
    np.testing.assert_allclose(sampled(FLIGHT, ramp, stamps)[:, 0], stamps / 1e9, atol=1e-15)
    on_rows = sample_stamps(FLIGHT, 250.0)
    np.testing.assert_array_equal(sampled(FLIGHT, FLIGHT.positions_m, on_rows), FLIGHT.positions_m[::2])


def test_a_range_that_ends_nowhere_is_sampled_without_a_warning() -> None:
    with np.errstate(invalid="raise"):
        found = sampled(FLIGHT, np.full((len(FLIGHT), 1), np.inf), FLIGHT.stamps_ns[:-1] + 500_000)
        assert np.isinf(found).all()
        assert np.isinf(sampled(FLIGHT, np.full((len(FLIGHT), 1), np.inf), FLIGHT.stamps_ns)).all()


@pytest.mark.parametrize("name", sorted(SENSORS))
def test_a_rate_that_the_flight_cannot_serve_is_refused_of_every_sensor(name: str) -> None:
    flight, kind = standing(1.0), SENSORS[name]
    spare = {"step_deg": 60.0} if "lidar" in name else {}
    at = [kind(rate_hz=rate_hz, **spare) for rate_hz in (1.0, 0.9, 0.0, -5.0)]  # type: ignore[call-arg]
    assert len(measure((at[0],), flight, BOX, 0)[name].stamps_ns) > 1
    for sensor, told in zip(
        at[1:],
        (
            r"rate_hz 0\.9: one reading takes 1\.11111 s, and the flight 1 s; raise rate_hz, or fly longer",
            "rate_hz 0: is not a positive number; give the readings per second",
            "rate_hz -5: is not a positive number; give the readings per second",
        ),
        strict=True,
    ):
        with pytest.raises(UserError, match=rf"^sensors\[1\], {name}: {told}$"):
            measure((Barometer() if name != "baro" else Gnss(), sensor), flight, BOX, 0)


def test_a_flight_that_a_crash_ends_at_once_has_a_record() -> None:
    assert len(flight_table(standing(0.004)).stamps_ns) == 1
