"""Satellite fixes against least squares solved densely, and when there is none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.trajectories.scene import BOX, block, standing
from uavbench.trajectories.sensors.gnss import Gnss
from uavbench.trajectories.sensors.satellites import sky
from uavbench.trajectories.wind.dryden import first_order

QUIET = Gnss(slow_m=0.0, white_m=0.0, doppler_m_s=0.0, rate_hz=1.0)
SATELLITES = 24


def flying(seconds: float = 20.0):
    """A vehicle that moves evenly, 10 Hz."""
    still = standing(seconds, height=30.0, step_ns=100_000_000)
    speed = np.array([1.0, -2.0, 0.5])
    along = still.positions_m + (still.stamps_ns / 1e9)[:, None] * speed
    return replace(still, positions_m=along, velocities_m_s=np.tile(speed, (len(still), 1)))


def geometry(gnss, table, flight):
    """Design matrices of each fix, and which satellites are in them."""
    rows = np.searchsorted(flight.stamps_ns, table.stamps_ns)
    sight, seen = gnss.view(flight.positions_m[rows], table.stamps_ns, BOX)
    return [np.column_stack([-s[v], np.ones(v.sum())]) for s, v in zip(sight, seen, strict=True)], seen


def test_without_noise_fixes_are_the_truth() -> None:
    flight = flying()
    table = QUIET.measure(flight, BOX, np.random.default_rng(0))
    assert table.columns == ("satellites", "pdop", "px_m", "py_m", "pz_m", "vx_m_s", "vy_m_s", "vz_m_s")
    np.testing.assert_allclose(table.values[:, 2:5], flight.positions_m[::10], atol=1e-9)
    np.testing.assert_allclose(table.values[:, 5:8], flight.velocities_m_s[::10], atol=1e-9)
    designs, seen = geometry(QUIET, table, flight)
    np.testing.assert_array_equal(table.column("satellites"), seen.sum(axis=1))
    dilution = [np.sqrt(np.trace(np.linalg.inv(A.T @ A)[:3, :3])) for A in designs]
    np.testing.assert_allclose(table.column("pdop"), dilution, rtol=1e-9)


@pytest.mark.parametrize("part", ["slow", "white", "doppler"])
def test_each_error_enters_by_least_squares(part: str) -> None:
    """Each satellite has its own slow error; white and Doppler errors are new in each fix."""
    flight = flying()
    gnss = replace(QUIET, rate_hz=2.0, **{{"slow": "slow_m", "white": "white_m", "doppler": "doppler_m_s"}[part]: 2.0})
    gnss = replace(gnss, slow_s=7.0) if part == "slow" else gnss
    table = gnss.measure(flight, BOX, np.random.default_rng(7))
    n = len(table.stamps_ns)
    white_rng, doppler_rng, *each = np.random.default_rng(7).spawn(2 + SATELLITES)
    if part == "slow":
        errors = np.column_stack([first_order(n, 0.5, gnss.slow_s, rng) for rng in each])
    else:
        errors = (white_rng if part == "white" else doppler_rng).standard_normal((n, SATELLITES))
    designs, seen = geometry(gnss, table, flight)
    found = table.values[:, 2:] - np.hstack([flight.positions_m, flight.velocities_m_s])[::5]
    for k, A in enumerate(designs):
        solved = np.linalg.lstsq(A, 2.0 * errors[k, seen[k]], rcond=None)[0][:3]
        expected = np.concatenate([solved * (part != "doppler"), solved * (part == "doppler")])
        np.testing.assert_allclose(found[k], expected, atol=1e-9)


def test_there_is_a_fix_with_four_satellites_and_a_good_geometry_only() -> None:
    flight = standing(40_000.0, height=30.0, step_ns=100_000_000_000)
    gnss = replace(QUIET, rate_hz=0.01, mask_deg=35.0, greatest_pdop=6.0)
    table = gnss.measure(flight, BOX, np.random.default_rng(0))
    count, pdop = table.column("satellites"), table.column("pdop")
    fixed = np.isfinite(table.values[:, 2:]).all(axis=1)
    assert {3.0, 4.0} <= set(count.tolist())
    np.testing.assert_array_equal(np.isnan(pdop), count < 4)
    np.testing.assert_array_equal(fixed, pdop <= 6.0)
    np.testing.assert_array_equal(fixed, ~np.isnan(table.values[:, 2:]).all(axis=1))
    assert fixed.any() and (pdop > 6.0).any()
    np.testing.assert_array_equal(np.isnan(table.column("px_m")) & (count >= 4), pdop > 6.0)


def test_the_view_is_the_sky_above_the_mask_turned_to_north() -> None:
    stamps, places = np.array([0, 7_200_000_000_000]), np.tile([50.0, 0.0, 30.0], (2, 1))
    for north in (0.0, 90.0, 30.0):
        gnss = Gnss(north_deg=north, mask_deg=20.0, latitude_deg=-35.0, epoch_s=1000.0)
        sight, seen = gnss.view(places, stamps, BOX)
        east_north_up = sky(np.array([1000.0, 8200.0]), -35.0)
        np.testing.assert_array_equal(seen, east_north_up[..., 2] > np.sin(np.radians(20.0)))
        turn = np.radians(north)  # the world's y axis points so far counter-clockwise from north
        east, north_ = np.array([np.cos(turn), -np.sin(turn)]), np.array([np.sin(turn), np.cos(turn)])
        level = east_north_up[..., :1] * east + east_north_up[..., 1:2] * north_
        np.testing.assert_allclose(sight[..., :2], level, atol=1e-12)
        np.testing.assert_array_equal(sight[..., 2], east_north_up[..., 2])


def test_a_wall_hides_the_satellites_behind_it() -> None:
    stamps, places = np.array([0]), np.array([[0.0, 0.0, 5.0]])
    gnss = Gnss(north_deg=30.0)  # else one satellite stands exactly along the wall
    open_sight, open_seen = gnss.view(places, stamps, BOX)
    sight, seen = gnss.view(places, stamps, block((1.0, -1e4, 0.0), (2.0, 1e4, 1e4)))
    np.testing.assert_array_equal(sight, open_sight)
    np.testing.assert_array_equal(seen[0], open_seen[0] & (sight[0, :, 0] < 0))
    assert seen.any() and (seen != open_seen).any()


def test_a_longer_flight_begins_with_the_same_fixes() -> None:
    short, long = (Gnss().measure(flying(s), BOX, np.random.default_rng(3)).values for s in (5.0, 10.0))
    np.testing.assert_array_equal(long[: len(short)], short)


def test_the_defaults_are_those_that_are_told() -> None:
    assert Gnss() == Gnss(5.0, 10.0, 1.0, 300.0, 0.3, 0.05, 12.0, 40.8, 0.0, 0.0)


def test_the_sky_is_that_of_24_satellites_on_circles_about_a_round_earth() -> None:
    """Satellites by rotations of their planes, seen from a place that turns with the Earth: other formulas."""
    times, latitude = np.array([0.0, 1234.5, 40_000.0]), 47.0
    found = sky(times, latitude)
    assert found.shape == (3, 24, 3)
    for k, t in enumerate(times):
        place = Rotation.from_euler("ZY", [7.2921151467e-5 * t, -np.radians(latitude)]).apply([6_371_000.0, 0, 0])
        up = place / np.linalg.norm(place)
        east = np.cross([0, 0, 1.0], up) / np.cos(np.radians(latitude))
        for number in range(24):
            plane, slot = divmod(number, 4)
            along = 90.0 * (slot + plane / 4) + 360.0 * t / 43_077.0
            turn = Rotation.from_euler("ZXZ", [60.0 * plane, 55.0, along], degrees=True)
            sight = turn.apply([26_560_000.0, 0, 0]) - place
            expected = np.array([east, np.cross(up, east), up]) @ sight / np.linalg.norm(sight)
            np.testing.assert_allclose(found[k, number], expected, atol=1e-9)
