"""The barometer and the flow deck by parts: against the standard atmosphere and the way that was flown."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.trajectories.scene import BOX, standing
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.sensors.barometer import Barometer, height_at, pressure_at
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.imu import Imu
from uavbench.trajectories.sensors.optical_flow import FlowDeck, flow_ground_truth
from uavbench.trajectories.wind.dryden import first_order

SCALE = 35.0 / 0.71674
EXACT = FlowDeck(flow_noise_px=0.0, range_noise_m=0.0)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_pressures_are_those_of_the_standard_atmosphere() -> None:
    """ISO 2533, table: 898.746 hPa at 1000 m, 540.199 hPa at 5000 m."""
    assert pressure_at(np.array([0.0, 1000.0, 5000.0]), 101325.0) == pytest.approx([101325, 89874.6, 54019.9], rel=2e-5)
    assert height_at(np.array([89874.6]), 101325.0) == pytest.approx([1000.0], abs=0.2)
    assert pressure_at(np.array([1000.0]), 50000.0) == pytest.approx([50000 * 0.887], rel=1e-3)


def test_height_follows_from_the_pressure_that_was_read() -> None:
    sensor = Barometer(drift_pa=30.0, floor_pressure_pa=98000.0)
    table = sensor.measure(standing(5.0, height=3.0), BOX, rng())
    assert table.columns == ("pressure_pa", "height_m")
    np.testing.assert_allclose(table.column("height_m"), height_at(table.column("pressure_pa"), 98000.0), atol=1e-9)
    quiet = Barometer(noise_pa=0.0, floor_pressure_pa=98000.0).measure(standing(1.0, height=3.0), BOX, rng())
    np.testing.assert_allclose(quiet.column("pressure_pa"), pressure_at(np.array([3.0]), 98000.0)[0], atol=1e-6)


def test_noise_is_white_and_the_drift_slow() -> None:
    still = standing(10_000.0, step_ns=500_000_000)
    ground_truth = pressure_at(np.array([1.0]), 101325.0)[0]
    drift = (
        Barometer(rate_hz=2.0, noise_pa=0.0, drift_pa=20.0, drift_s=25.0).measure(still, BOX, rng()).values[:, 0]
        - ground_truth
    )
    assert drift.std() == pytest.approx(20.0, rel=0.1)
    for lag in (25, 50, 100):
        alike = np.corrcoef(drift[lag:], drift[:-lag])[0, 1]
        assert alike == pytest.approx(np.exp(-lag / 50.0), abs=0.1)
    white = Barometer(rate_hz=2.0, noise_pa=3.0).measure(still, BOX, rng()).values[:, 0] - ground_truth
    assert white.std() == pytest.approx(3.0, rel=0.03)
    noise_rng, drift_rng = rng().spawn(2)
    np.testing.assert_allclose(white, 3.0 * noise_rng.standard_normal(len(white)), atol=1e-6)
    np.testing.assert_allclose(drift, 20.0 * first_order(len(drift), 0.5, 25.0, drift_rng), atol=1e-6)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.03
    both = Barometer(rate_hz=2.0, noise_pa=3.0, drift_pa=20.0, drift_s=25.0).measure(still, BOX, rng()).values[:, 0]
    np.testing.assert_allclose(both - ground_truth, white + drift, atol=1e-6)


@pytest.mark.parametrize("sensor", [Barometer(drift_pa=5.0), FlowDeck()])
def test_a_longer_flight_begins_with_the_same_readings(sensor: Barometer | FlowDeck) -> None:
    short, long = (sensor.measure(standing(s), BOX, rng(3)).values for s in (0.5, 1.0))
    np.testing.assert_array_equal(long[: len(short)], short)


def test_the_defaults_are_those_that_are_told() -> None:
    assert Barometer() == Barometer(50.0, 1.0, 0.0, 120.0, 101325.0)
    assert FlowDeck() == FlowDeck(50.0, 35.0, 0.71674, 0.25, 0.0025, 0.08, 4.0)


# The flow deck


def speeding(seconds: float, height: float, rate_m_s2: tuple[float, float] = (0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """A level vehicle at one height that gathers speed evenly, and turns evenly by its gyroscope alone."""
    still = standing(seconds, height)
    t = (still.stamps_ns / 1e9)[:, None]
    speed = np.hstack([t * rate_m_s2, 0 * t])
    return replace(still, velocities_m_s=speed, angular_velocities_rad_s=np.tile(turn, (len(still), 1)))


def test_what_was_counted_is_the_way_flown_to_half_a_pixel_at_every_reading() -> None:
    """Of an even acceleration a the flow gathers to a t^2 / 2 over the height; nothing is lost by rounding."""
    table = EXACT.measure(speeding(2.0, 0.5, (0.8, -0.3)), BOX, rng())
    assert table.columns == ("dx_px", "dy_px", "range_m")
    t = table.stamps_ns / 1e9
    for column, a in (("dx_px", 0.8), ("dy_px", -0.3)):
        gathered = SCALE * 0.5 * a * t**2 / 0.5
        assert np.abs(np.cumsum(table.column(column)) - gathered).max() <= 0.5 + 1e-9
        assert (table.column(column) % 1 == 0).all()
        assert table.column(column)[0] == 0.0


def test_turning_is_taken_for_flow_as_the_firmware_models_it() -> None:
    table = EXACT.measure(speeding(2.0, 0.5, turn=(0.4, 0.7, 5.0)), BOX, rng())
    assert table.column("dx_px").sum() == pytest.approx(-0.7 * 2.0 * SCALE, abs=0.5)
    assert table.column("dy_px").sum() == pytest.approx(0.4 * 2.0 * SCALE, abs=0.5)


def test_another_chip_scales_the_counts() -> None:
    twice = replace(EXACT, pixels=70.0).measure(speeding(1.0, 0.5, (1.0, 0.0)), BOX, rng())
    narrow = replace(EXACT, aperture_rad=0.71674 / 2).measure(speeding(1.0, 0.5, (1.0, 0.0)), BOX, rng())
    for table in (twice, narrow):
        assert table.column("dx_px").sum() == pytest.approx(2 * SCALE * 0.5 / 0.5, abs=0.5)


def test_flow_noise_is_that_of_each_reading() -> None:
    sensor = FlowDeck(flow_noise_px=3.0)
    table = sensor.measure(standing(60.0, 0.5), BOX, rng())
    noise = 3.0 * rng().spawn(2)[0].standard_normal((len(table.stamps_ns), 2))
    counted = np.cumsum(table.values[:, :2], axis=0)
    assert np.abs(counted - np.cumsum(noise, axis=0)).max() <= 0.5 + 1e-9
    assert np.abs(np.corrcoef(table.column("dx_px"), table.column("dy_px"))[0, 1]) < 0.06


@pytest.mark.parametrize(
    ("height", "sigma_m"),
    [(1.0, 0.0025 * (1 + 80 ** (-1.0))), (2.5, 0.005), (3.25, 0.0025 * (1 + 80**0.5)), (4.0, 0.2025)],
)
def test_range_noise_grows_with_the_range(height: float, sigma_m: float) -> None:
    """As zranger2.c has it: standard deviation 0.0025 (1 + exp(c (range - 2.5))), c = ln(0.2 / 0.0025) / 1.5."""
    table = FlowDeck().measure(standing(60.0, height), BOX, rng())
    away = table.column("range_m") - height
    assert away.std() == pytest.approx(sigma_m, rel=0.06)
    assert abs(away.mean()) < 0.1 * sigma_m
    double = FlowDeck(range_noise_m=0.005).measure(standing(60.0, height), BOX, rng())
    np.testing.assert_allclose(double.column("range_m") - height, 2 * away, atol=1e-9)


@pytest.mark.parametrize(
    ("height", "flows", "ranges"),
    [(0.0799, False, True), (0.08, True, True), (4.0, True, True), (4.0001, False, False), (0.5, True, True)],
)
def test_flow_and_range_are_there_within_their_limits(height: float, flows: bool, ranges: bool) -> None:
    table = EXACT.measure(standing(0.5, height), BOX, rng())
    assert np.isfinite(table.values[:, :2]).all() == flows == np.isfinite(table.values[:, :2]).any()
    assert np.isfinite(table.values[:, 2]).all() == ranges == np.isfinite(table.values[:, 2]).any()
    if ranges:
        np.testing.assert_allclose(table.column("range_m"), height)
    high = replace(EXACT, least_range_m=0.3, greatest_range_m=0.4)
    assert np.isnan(high.measure(standing(0.5, 0.5), BOX, rng()).values).all()


def tilted(R: Rotation, velocity=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)):
    still = standing(0.0, height=2.0)
    return replace(
        still, quaternions_wxyz=R.as_quat()[None, [3, 0, 1, 2]], velocities_m_s=np.array([velocity]),
        angular_velocities_rad_s=np.array([rates]),
    )  # fmt: skip


def test_a_tilted_deck_looks_aslant() -> None:
    R = Rotation.from_euler("ZYX", [40.0, 25.0, -10.0], degrees=True)
    flow, distance = flow_ground_truth(tilted(R, (1.0, 2.0, 0.5), (0.3, -0.2, 0.1)), BOX)
    slant = 2.0 / (np.cos(np.radians(25.0)) * np.cos(np.radians(10.0)))
    assert distance == pytest.approx([slant])
    v = R.inv().apply([1.0, 2.0, 0.5])
    assert flow[0] == pytest.approx([v[0] / slant + 0.2, v[1] / slant + 0.3])


@pytest.mark.parametrize("roll_deg", [90.0, 120.0, 180.0])
def test_upside_down_there_is_no_floor(roll_deg: float) -> None:
    flow, distance = flow_ground_truth(
        tilted(Rotation.from_euler("x", roll_deg + 1e-3, degrees=True), (1.0, 0, 0)), BOX
    )
    assert distance == pytest.approx([np.inf])
    assert flow[0] == pytest.approx([0.0, 0.0])
    table = FlowDeck().measure(tilted(Rotation.from_euler("x", roll_deg + 1e-3, degrees=True)), BOX, rng())
    assert np.isnan(table.values).all()


def test_the_nearer_of_structure_and_floor_is_what_lies_beneath() -> None:
    roof = ObstacleMesh(np.array([[4.0, -1, 1], [6.0, -1, 1], [5.0, 2, 1]]), np.array([[0, 1, 2]]))
    cellar = ObstacleMesh(np.array([[4.0, -1, -1], [6.0, -1, -1], [5.0, 2, -1]]), np.array([[0, 1, 2]]))
    for mesh, expected in ((roof, 1.0), (cellar, 2.0)):
        assert flow_ground_truth(standing(0.0, height=2.0), mesh)[1] == pytest.approx([expected])


def test_a_deck_read_in_flight_reads_the_same_and_loses_no_fraction_of_a_count() -> None:
    """Some readings at a time, as many as a turn of the loop has: what is carried over is carried on."""
    flight = speeding(2.0, 0.5, (0.8, -0.3))
    for deck in (EXACT, FlowDeck()):
        whole = deck.measure(flight, BOX, rng(3))
        reader, begun = deck.begin(len(whole.stamps_ns), BOX, rng(3)), 0
        parts = []
        for size in (1, 2, 5, 1, 30, len(whole.stamps_ns)):
            stamps = whole.stamps_ns[begun : begun + size]
            parts.append(reader.read(flight, stamps))
            begun += size
        np.testing.assert_allclose(np.concatenate(parts), whole.values, atol=1e-12)


@pytest.mark.parametrize("sensor", [Barometer(drift_pa=5.0), Imu(), Gnss()])
def test_a_sensor_read_in_flight_reads_the_same(sensor: Barometer | Imu | Gnss) -> None:
    flight = standing(1.0, 20.0)
    whole = sensor.measure(flight, BOX, rng(3))
    reader = sensor.begin(len(whole.stamps_ns), BOX, rng(3))
    parts = [reader.read(flight, stamps) for stamps in np.array_split(whole.stamps_ns, 4)]
    np.testing.assert_array_equal(np.concatenate(parts), whole.values)
