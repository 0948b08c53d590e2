"""Laser range finder and lidar: against analytic planes, their noise, what comes back, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tests.trajectories.scene import BOX, block, both, standing
from uavbench.scenes.dataset.table_files import read_records
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.errors import UserError
from uavbench.trajectories.flight_record import Flight
from uavbench.trajectories.obstacles import ObstacleMesh
from uavbench.trajectories.paths.pilot.hand_pilot import HandPilot
from uavbench.trajectories.sensors import ranging
from uavbench.trajectories.sensors.lidar import Lidar2d, Lidar3d
from uavbench.trajectories.sensors.range_finder import RangeFinder
from uavbench.trajectories.sensors.registry import measure, write_flight
from uavbench.trajectories.sensors.sensor import sample_stamps
from uavbench.trajectories.simulation.flight import FlightSpec, fly

FLIGHT = fly(FlightSpec(path=HandPilot(duration_s=1.0)), Mount(), BOX, 0)
ROOM = both(
    both(block((-6.0, -6.0, 0.0), (-5.0, 6.0, 4.0)), block((5.0, -6.0, 0.0), (6.0, 6.0, 4.0))),
    both(block((-6.0, -6.0, 0.0), (6.0, -5.0, 4.0)), block((-6.0, 5.0, 0.0), (6.0, 6.0, 4.0))),
)
"""Four walls around the flight, their inner faces 5 m from the middle."""
EXACT = {"noise_m": 0.0, "far_noise_m": 0.0, "resolution_m": 0.0, "reflectance": 1.0}


def poses(flight: Flight, stamps: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Places and attitudes at stamps by scipy: linear for places, spherical for attitudes."""
    t = flight.stamps_ns.astype(float)
    places = np.column_stack([np.interp(stamps, t, flight.positions_m[:, k]) for k in range(3)])
    return places, Slerp(t, Rotation.from_quat(flight.quaternions_wxyz[:, [1, 2, 3, 0]]))(stamps)


def to_planes(places: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Distance to the floor or the room's walls, whichever comes first, of what passes over no wall."""
    out = np.full(len(ways), np.inf)
    for axis, value in ((0, -5.0), (0, 5.0), (1, -5.0), (1, 5.0), (2, 0.0)):
        with np.errstate(divide="ignore"):
            t = (value - places[:, axis]) / ways[:, axis]
        height = places[:, 2] + t * ways[:, 2]
        out = np.where((t > 0) & (height < 4.0), np.minimum(out, t), out)
    return out


def test_a_range_finder_reads_the_distance_to_analytic_planes() -> None:
    sensor = RangeFinder(
        rate_hz=333.0, offset_m=(0.05, -0.02, 0.01), yaw_deg=20.0, pitch_deg=-30.0, roll_deg=5.0, **EXACT
    )
    table = sensor.measure(FLIGHT, ROOM, np.random.default_rng(0))
    places, attitudes = poses(FLIGHT, table.stamps_ns)
    turn = Rotation.from_euler("ZYX", [20.0, 30.0, 5.0], degrees=True)
    expected = to_planes(places + attitudes.apply([0.05, -0.02, 0.01]), (attitudes * turn).apply([1.0, 0.0, 0.0]))
    error = np.abs(table.column("range_m") - expected)
    assert error.mean() < 1e-5  # asked for: 1e-4
    assert error.max() < 1e-4
    np.testing.assert_array_equal(table.column("range_m"), table.column("true_range_m"))


@pytest.mark.parametrize("sensor", [Lidar2d(step_deg=3.0, **EXACT), Lidar3d(step_deg=6.0, pitch_deg=10.0, **EXACT)])
def test_a_lidar_reads_the_distance_to_analytic_planes_from_where_the_vehicle_is_at_each_step(sensor: Lidar2d) -> None:
    table = sensor.measure(FLIGHT, ROOM, np.random.default_rng(0))
    places, attitudes = poses(FLIGHT, table.stamps_ns)
    turn = Rotation.from_euler("ZYX", [0.0, -sensor.pitch_deg, 0.0], degrees=True)
    azimuth, checked = table.column("azimuth_rad"), 0
    for ring, elevation in enumerate(np.radians(sensor.elevations_deg)):
        level = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(len(azimuth), np.tan(elevation))])
        ways = (attitudes * turn).apply(level * np.cos(elevation))
        expected, read = to_planes(places, ways), table.column(f"range_{ring:02d}_m")
        there = np.isfinite(expected) & np.isfinite(read)
        error = np.abs(read - expected)[there]
        assert error.mean() < 1e-5  # asked for: 1e-4
        assert error.max() < 2e-4
        checked += int(there.sum())
    assert checked > 0.6 * len(azimuth) * len(sensor.elevations_deg)
    assert (np.diff(table.stamps_ns) > 0).all()


def test_steps_of_a_turn_are_late_by_their_angle() -> None:
    sensor = Lidar2d(rate_hz=20.0, field_deg=180.0, step_deg=45.0)
    table = sensor.measure(standing(0.21), BOX, np.random.default_rng(0))
    assert table.stamps_ns[:6].tolist() == [0, 6_250_000, 12_500_000, 18_750_000, 25_000_000, 50_000_000]
    assert np.degrees(table.column("azimuth_rad")[:6]) == pytest.approx([-90, -45, 0, 45, 90, -90])
    assert len(table.stamps_ns) == 4 * 5
    whole = Lidar3d()
    assert len(whole.azimuths_rad) == 1800 and whole.rays_per_s == 10 * 1800 * 16
    assert len(Lidar2d().azimuths_rad) == 1081


def test_noise_grows_beyond_the_far_distance_and_readings_come_in_steps() -> None:
    sensor = RangeFinder(rate_hz=500.0, reflectance=1.0)
    for distance, sigma in ((3.0, 0.025), (8.0, 0.1)):
        wall = block((5.0 + distance, -9.0, 0.0), (20.0, 9.0, 9.0))
        table = sensor.measure(standing(8.0), wall, np.random.default_rng(1))
        assert table.column("true_range_m") == pytest.approx(distance, abs=1e-9)
        error = table.column("range_m") - distance
        assert error.std() == pytest.approx(sigma, rel=0.05)
        assert abs(error.mean()) < 4 * sigma / np.sqrt(len(error))
        centimetres = table.column("range_m") * 100
        assert np.abs(centimetres - np.round(centimetres)).max() < 1e-9


@pytest.mark.parametrize(
    "sensor",
    [
        RangeFinder(rate_hz=500.0, reflectance=1.0, resolution_m=0.0),
        Lidar2d(field_deg=60.0, step_deg=6.0, elevations_deg=(-8.0, 0.0, 8.0), reflectance=1.0, resolution_m=0.0),
    ],
)
def test_no_two_readings_have_the_same_noise(sensor: RangeFinder, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of neighbouring rings, steps, turns and blocks of rays: uncorrelated at every lag."""
    monkeypatch.setattr(ranging, "BLOCK", 64)
    wall = block((10.0, -9.0, 0.0), (20.0, 9.0, 9.0))
    table = sensor.measure(standing(2.0), wall, np.random.default_rng(5))
    names = [name for name in table.columns if name.startswith("range_")]
    noise = np.column_stack([table.column(name) - table.column(f"true_{name}") for name in names]).ravel()
    assert np.isfinite(noise).all()
    spectrum = np.abs(np.fft.rfft(noise / noise.std(), 2 * len(noise))) ** 2
    correlation = np.fft.irfft(spectrum)[1 : len(noise) // 2] / len(noise)
    assert np.abs(correlation).max() < 6 / np.sqrt(len(noise))


def slanted(angle_deg: float) -> ObstacleMesh:
    """A plane 10 m ahead of what stands at (5, 0, 1), turned from squarely by an angle."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    across, middle = np.array([s, c, 0.0]) * 40, np.array([15.0, 0.0, 1.0])
    up = np.array([0.0, 0.0, 40.0])
    corners = np.array([middle - across - up, middle + across - up, middle + across + up, middle - across + up])
    return ObstacleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def test_light_comes_back_from_as_far_as_reflectance_and_incidence_let_it() -> None:
    sensor = RangeFinder(greatest_range_m=20.0, rated_reflectance=0.8, reflectance=0.4)
    # 10 m are seen while 20 sqrt(0.5 cos a) >= 10: up to 60 degrees.
    for angle, seen in ((0.0, True), (59.0, True), (61.0, False)):
        table = sensor.measure(standing(0.1), slanted(angle), np.random.default_rng(0))
        assert np.isfinite(table.column("range_m")).all() == seen
        assert table.column("true_range_m") == pytest.approx(10.0)
    near = replace(sensor, least_range_m=11.0).measure(standing(0.1), slanted(0.0), np.random.default_rng(0))
    assert np.isnan(near.column("range_m")).all()
    up = replace(sensor, pitch_deg=90.0).measure(standing(0.1), BOX, np.random.default_rng(0))
    assert np.isnan(up.values).all()


@pytest.mark.parametrize("sensor", [RangeFinder(), Lidar2d(step_deg=5.0), Lidar3d(step_deg=5.0)])
def test_readings_repeat_under_a_seed_and_a_longer_flight_begins_with_the_same(sensor: RangeFinder) -> None:
    first, again, longer = (
        sensor.measure(standing(seconds), BOX, np.random.default_rng(3)) for seconds in (0.4, 0.4, 0.6)
    )
    np.testing.assert_array_equal(first.values, again.values)
    np.testing.assert_array_equal(first.values, longer.values[: len(first.values)])


def test_a_range_finder_read_in_flight_reads_the_same() -> None:
    sensor = RangeFinder(pitch_deg=-80.0)
    whole = sensor.measure(FLIGHT, BOX, np.random.default_rng(2))
    reader = sensor.begin(len(whole.stamps_ns), BOX, np.random.default_rng(2))
    parts = [reader.read(FLIGHT, stamps) for stamps in np.array_split(sample_stamps(FLIGHT, sensor.rate_hz), 7)]
    np.testing.assert_allclose(np.concatenate(parts), whole.values, atol=1e-9)


def test_mistakes_name_the_sensor_and_what_to_do() -> None:
    flight = standing(0.5)  # at (5, 0, 1)
    for sensor, word in (
        (
            Lidar2d(offset_m=(-5.0, 0.0, -0.9)),
            r"sensors\[0\], lidar-2d: t = 0.00 s, at \(0.00, 0.00, 0.10\) m: it is inside the",
        ),
        (RangeFinder(offset_m=(0.0, 0.0, -1.5)), r"sensors\[0\], range-finder: .*under the floor; change its offset_m"),
        (
            Lidar3d(rate_hz=0.5),
            r"sensors\[0\], lidar-3d: rate_hz 0.5: one reading takes 2 s, and the flight 0.5 s; raise rate_hz",
        ),
    ):
        with pytest.raises(UserError, match=word):
            measure((sensor,), flight, BOX, 0)
    with pytest.raises(ValueError, match="elevations_deg: give 1 to 128"):
        Lidar2d(elevations_deg=())


def test_what_a_lidar_measures_and_what_is_true_are_files_of_their_own(tmp_path: Path) -> None:
    sensors = (RangeFinder(), Lidar3d(step_deg=20.0), Lidar3d(step_deg=30.0))
    names = write_flight(FLIGHT, sensors, ROOM, 0, tmp_path)
    assert names == ["flight.csv", "range-finder.csv", "lidar-3d.npy", "lidar-3d-2.npy"]
    read, truth = (np.load(tmp_path / f"lidar-3d{end}.npy") for end in ("", "_truth"))
    assert read.dtype.names[:3] == ("stamp_ns", "azimuth_rad", "range_00_m")
    assert not [name for name in read.dtype.names if "true" in name]
    assert truth.dtype.names == ("stamp_ns", *(f"true_range_{k:02d}_m" for k in range(16)))
    table = measure(sensors, FLIGHT, ROOM, 0)["lidar-3d"]
    for name in table.columns:
        np.testing.assert_array_equal((truth if "true" in name else read)[name], table.column(name))
    np.testing.assert_array_equal(read_records(tmp_path / "lidar-3d.npy"), read)


def test_an_array_that_is_none_is_refused(tmp_path: Path) -> None:
    write_flight(FLIGHT, (Lidar2d(step_deg=30.0),), ROOM, 0, tmp_path)
    whole = (tmp_path / "lidar-2d.npy").read_bytes()
    np.save(tmp_path / "plain.npy", np.zeros((3, 3)))
    np.save(tmp_path / "objects.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    huge = whole.replace(b"'shape': (", b"'shape': (9999999").replace(b"       \n", b"\n")
    for name, data in {
        "cut": whole[:-5], "longer": whole + b"x",
        "text": b"stamp_ns,range_m\n", "empty": b"", "huge": huge[: len(whole)],
    }.items():  # fmt: skip
        (tmp_path / f"{name}.npy").write_bytes(data)
    for name in ("cut", "longer", "text", "empty", "huge", "plain", "objects"):
        with pytest.raises(UserError, match=rf"{name}.npy: not an array of readings"):
            read_records(tmp_path / f"{name}.npy")


def test_the_defaults_are_those_of_the_data_sheets() -> None:
    """Hokuyo's UTM-30LX, Velodyne's VLP-16 and Garmin's LIDAR-Lite v3, as their classes tell."""
    middle = ((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    assert RangeFinder() == RangeFinder(50.0, *middle, 0.05, 40.0, 0.7, 0.3, 0.025, 5.0, 0.1, 0.01)
    plane = Lidar2d(40.0, *middle, 0.1, 30.0, 0.9, 0.3, 0.01, 10.0, 0.03, 0.001, 270.0, 0.25, (0.0,))
    assert Lidar2d() == plane
    rings = (-15.0, -13.0, -11.0, -9.0, -7.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0)
    assert Lidar3d() == Lidar3d(10.0, *middle, 0.5, 100.0, 0.8, 0.3, 0.03, 10.0, 0.03, 0.002, 360.0, 0.2, rings)
    assert Lidar2d.binary and Lidar3d.binary


def test_limits_of_what_a_lidar_is() -> None:
    assert Lidar2d(elevations_deg=tuple(np.linspace(-90.0, 90.0, 128))).rays_per_s == 40 * 1081 * 128
    for bad, told in (((5.0, 5.0), "5 follows 5"), ((5.0, -3.0), "-3 follows 5")):
        with pytest.raises(ValueError, match=f"elevations_deg: {told}; name each ring once, from the lowest up"):
            Lidar2d(elevations_deg=bad)
    for bad in ((), (0.0,) * 129, (90.5,), (0.0, -91.0)):
        with pytest.raises(ValueError, match="give 1 to 128 angles from -90 to 90"):
            Lidar2d(elevations_deg=bad)
    for kind in (RangeFinder, Lidar2d):
        for least in (3.0, 4.0):
            with pytest.raises(ValueError, match="is not below greatest_range_m 3"):
                kind(least_range_m=least, greatest_range_m=3.0)
        assert kind(least_range_m=2.999, greatest_range_m=3.0).least_range_m == 2.999


@pytest.mark.parametrize(
    ("field", "step", "expected"),
    [
        (10.0, 120.0, [-5.0]),
        (0.3, 0.1, [-0.15, -0.05, 0.05, 0.15]),  # 0.3 / 0.1 is just below 3 in floating point
        (100.0, 40.0, [-50.0, -10.0, 30.0]),
        (360.0, 120.0, [-180.0, -60.0, 60.0]),
    ],
)
def test_azimuths_fill_the_field_in_whole_steps(field: float, step: float, expected: list[float]) -> None:
    assert np.degrees(Lidar2d(field_deg=field, step_deg=step).azimuths_rad) == pytest.approx(expected)


def test_turns_that_end_with_the_flight_count() -> None:
    sensor = Lidar2d(rate_hz=50.0, field_deg=90.0, step_deg=45.0)
    for seconds, turns in ((0.02, 1), (0.038, 1), (0.04, 2)):
        table = sensor.measure(standing(seconds), BOX, np.random.default_rng(0))
        assert len(table.stamps_ns) == 3 * turns
    with pytest.raises(UserError, match="rate_hz 50: the flight ends before the first scan does"):
        sensor.measure(standing(0.0), BOX, np.random.default_rng(0))
    begun = replace(standing(0.02), stamps_ns=standing(0.02).stamps_ns + 10**9)
    assert sensor.measure(begun, BOX, np.random.default_rng(0)).stamps_ns.tolist() == [
        10**9, 10**9 + 2_500_000, 10**9 + 5_000_000,
    ]  # fmt: skip


def test_a_reading_is_never_negative_and_near_ones_are_kept() -> None:
    wall = block((5.25, -9.0, 0.0), (20.0, 9.0, 9.0))
    plain = RangeFinder(resolution_m=0.0).measure(standing(2.0), wall, np.random.default_rng(0)).column("range_m")
    assert plain.mean() == pytest.approx(0.25, abs=0.02) and plain.std() == pytest.approx(0.025, rel=0.2)
    wild = RangeFinder(noise_m=1.0).measure(standing(2.0), wall, np.random.default_rng(0)).column("range_m")
    assert wild.min() == 0.0 and (wild == 0.0).mean() == pytest.approx(0.4, abs=0.1)


@pytest.mark.parametrize("away", [0.25, 8.0])
def test_the_ends_of_the_range_are_within_it(away: float) -> None:
    """The wall at 0.25 or 8 m, both exact in binary: at either end of the range, and just out of it."""
    wall, flight = block((5.0 + away, -9.0, 0.0), (40.0, 9.0, 9.0)), standing(0.1)
    sensor = RangeFinder(reflectance=0.7, rated_reflectance=0.7, far_m=away, noise_m=0.0, far_noise_m=0.5)
    for least, greatest, seen in (
        (away, 40.0, True), (0.05, away, True), (away + 1e-6, 40.0, False), (0.05, away - 1e-6, False),
    ):  # fmt: skip
        if least < greatest:
            limited = replace(sensor, least_range_m=least, greatest_range_m=greatest)
            read = limited.measure(flight, wall, np.random.default_rng(0)).column("range_m")
            assert np.isfinite(read).all() == seen == np.isfinite(read).any()
            assert not seen or read.std() > 0.05, "from far_m on the noise is that of far readings"


def test_a_sensor_on_the_floor_or_one_that_comes_into_the_structure_is_refused() -> None:
    down = RangeFinder(offset_m=(0.0, 0.0, -1.0))
    with pytest.raises(UserError, match="it is under the floor"):
        down.measure(standing(0.5), BOX, np.random.default_rng(0))
    n = len(standing(0.5))
    toward = replace(standing(0.5), positions_m=np.linspace([5.0, 0.0, 0.1], [0.0, 0.0, 0.1], n))
    with pytest.raises(UserError, match=r"t = 0.4[89] s, at \(0.[12]\d, 0.00, 0.10\) m: it is inside the structure"):
        RangeFinder().measure(toward, BOX, np.random.default_rng(0))
    assert len(RangeFinder(rate_hz=2.0).measure(standing(0.5), BOX, np.random.default_rng(0)).stamps_ns) == 2
    with pytest.raises(UserError, match=r"one reading takes 1 s, and the flight 0\.5 s"):
        RangeFinder(rate_hz=1.0).measure(standing(0.5), BOX, np.random.default_rng(0))
    assert len(RangeFinder(rate_hz=1.0).measure(standing(0.0), BOX, np.random.default_rng(0)).stamps_ns) == 1


@pytest.mark.parametrize(("made", "told"), [
    (lambda: RangeFinder(noise_m=25.0), "noise_m 25 is more than 2 m; give it in metres"),
    (lambda: RangeFinder(far_noise_m=100.0), "far_noise_m 100 is more than"),
    (lambda: RangeFinder(resolution_m=10.0), "resolution_m 10 is more than"),
    (lambda: Lidar2d(offset_m=(0.0, 0.0, 40.0)), r"offset_m .*40.* is more than 10 m from the body; give it in metres"),
])  # fmt: skip
def test_parameters_in_millimetres_are_refused(made, told):
    with pytest.raises(ValueError, match=told):
        made()
