"""The inertial sensors by parts: what each parameter does, and the kinematics of a sensor off the centre."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.trajectories.scene import BOX, standing
from uavbench.trajectories.camera_mount import Mount
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.sensors.imu import Imu, ImuBmi088, inertial_ground_truth
from uavbench.trajectories.vehicle.quadrotor import GRAVITY_M_S2

QUIET = Imu(
    gyro_noise_rad_s_sqrt_hz=0.0,
    gyro_walk_rad_s2_sqrt_hz=0.0,
    accel_noise_m_s2_sqrt_hz=0.0,
    accel_walk_m_s3_sqrt_hz=0.0,
)


def tumbling(n: int = 5):
    """Rows of unrelated motion."""
    rng = np.random.default_rng(0)
    q = rng.normal(size=(n, 4))
    return replace(
        standing((n - 1) * 0.002),
        quaternions_wxyz=q / np.linalg.norm(q, axis=1, keepdims=True),
        accelerations_m_s2=rng.normal(size=(n, 3)),
        angular_velocities_rad_s=rng.normal(size=(n, 3)),
        angular_accelerations_rad_s2=rng.normal(size=(n, 3)),
    )


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_in_flight_it_reads_what_it_measures_of_the_whole_flight() -> None:
    flight, sensor = tumbling(51), Imu(rate_hz=500.0)
    table = sensor.measure(flight, BOX, np.random.default_rng(3))
    reader = sensor.begin(len(table.stamps_ns), BOX, np.random.default_rng(3))
    rows = [reader.read(flight, stamps) for stamps in np.split(table.stamps_ns, [20, 21])]
    np.testing.assert_array_equal(np.vstack(rows), table.values)


def test_specific_force_is_that_of_a_point_of_a_turning_body() -> None:
    flight, r = tumbling(), np.array([0.3, -0.2, 0.1])
    omega, force = inertial_ground_truth(flight, r)
    np.testing.assert_array_equal(omega, flight.angular_velocities_rad_s)
    for k in range(len(flight)):
        R = Rotation.from_quat(flight.quaternions_wxyz[k, [1, 2, 3, 0]]).as_matrix()
        W, A = skew(flight.angular_velocities_rad_s[k]), skew(flight.angular_accelerations_rad_s2[k])
        expected = R.T @ (flight.accelerations_m_s2[k] + [0, 0, GRAVITY_M_S2]) + (A + W @ W) @ r
        np.testing.assert_allclose(force[k], expected, atol=1e-12)


def test_without_noise_readings_are_the_truth_and_the_bias_that_is_told() -> None:
    flight = tumbling(51)
    sensor = replace(QUIET, rate_hz=500.0, gyro_bias_rad_s=0.1, accel_bias_m_s2=0.2, offset_m=(0.3, -0.2, 0.1))
    table = sensor.measure(flight, BOX, np.random.default_rng(1))
    assert table.columns == (
        "wx_rad_s", "wy_rad_s", "wz_rad_s", "ax_m_s2", "ay_m_s2", "az_m_s2",
        "gyro_bias_x_rad_s", "gyro_bias_y_rad_s", "gyro_bias_z_rad_s",
        "accel_bias_x_m_s2", "accel_bias_y_m_s2", "accel_bias_z_m_s2",
    )  # fmt: skip
    omega, force = inertial_ground_truth(flight, np.array(sensor.offset_m))
    np.testing.assert_allclose(table.values[:, :6], np.hstack([omega, force]) + table.values[:, 6:], atol=1e-12)
    assert (table.values[:, 6:] == table.values[0, 6:]).all()
    assert len(set(table.values[0, 6:].tolist())) == 6


def test_biases_begin_at_random_values_of_their_own_deviations() -> None:
    sensor = replace(QUIET, gyro_bias_rad_s=0.01, accel_bias_m_s2=0.3)
    begun = np.array([sensor.measure(standing(0.0), BOX, np.random.default_rng(k)).values[0, 6:] for k in range(400)])
    np.testing.assert_allclose(begun.mean(axis=0) / ([0.01] * 3 + [0.3] * 3), 0.0, atol=0.2)
    np.testing.assert_allclose(begun.std(axis=0), [0.01] * 3 + [0.3] * 3, rtol=0.12)
    assert np.abs(np.corrcoef(begun.T) - np.eye(6)).max() < 0.2


def test_white_noise_and_the_walk_have_the_deviations_of_kalibrs_model() -> None:
    rate = 100.0
    noisy = replace(QUIET, rate_hz=rate, gyro_noise_rad_s_sqrt_hz=0.02, accel_noise_m_s2_sqrt_hz=0.5)
    walking = replace(QUIET, rate_hz=rate, gyro_walk_rad_s2_sqrt_hz=0.03, accel_walk_m_s3_sqrt_hz=0.7)
    still = standing(40.0, step_ns=10_000_000)
    level = np.array([0, 0, 0, 0, 0, GRAVITY_M_S2])
    white = noisy.measure(still, BOX, np.random.default_rng(2)).values[:, :6] - level
    np.testing.assert_allclose(white.std(axis=0), [0.02 * 10] * 3 + [0.5 * 10] * 3, rtol=0.05)
    assert np.abs(np.corrcoef(white.T) - np.eye(6)).max() < 0.06
    biases = walking.measure(still, BOX, np.random.default_rng(2)).values
    np.testing.assert_allclose(np.diff(biases[:, 6:], axis=0).std(axis=0), [0.03 / 10] * 3 + [0.7 / 10] * 3, rtol=0.05)
    np.testing.assert_allclose(biases[:, :6] - level, biases[:, 6:], atol=1e-12)


def test_a_longer_flight_begins_with_the_same_readings() -> None:
    short, long = (Imu().measure(standing(s), BOX, np.random.default_rng(3)).values for s in (0.5, 1.0))
    np.testing.assert_array_equal(long[: len(short)], short)


def test_readings_end_at_both_ends_of_both_ranges() -> None:
    n = 11
    signs = np.where(np.arange(n) % 2, 1.0, -1.0)[:, None]
    shaken = replace(
        standing(0.02), angular_velocities_rad_s=signs * [1.0, 30.0, 2.0], accelerations_m_s2=signs * [1.0, 90.0, 2.0]
    )
    sensor = replace(QUIET, rate_hz=500.0, gyro_range_rad_s=5.0, accel_range_m_s2=50.0)
    table = sensor.measure(shaken, BOX, np.random.default_rng(0)).values
    np.testing.assert_allclose(table[:, :3], signs * [1.0, 5.0, 2.0])
    np.testing.assert_allclose(table[:, 3:5], signs * [1.0, 50.0])


def test_the_defaults_are_those_of_the_publications() -> None:
    """EuRoC's imu0/sensor.yaml (ADIS16448; ranges 1000 deg/s and 18 g) and the BMI088's data sheet with 24 g."""
    assert Imu() == Imu(200.0, 1.6968e-4, 1.9393e-5, 2.0e-3, 3.0e-3, 0.0, 0.0, 17.45, 176.0, (0.0, 0.0, 0.0))
    assert Imu().gyro_range_rad_s == pytest.approx(np.radians(1000), rel=1e-3)
    assert Imu().accel_range_m_s2 == pytest.approx(18 * GRAVITY_M_S2, rel=5e-3)
    small = ImuBmi088()
    assert small.gyro_noise_rad_s_sqrt_hz == pytest.approx(np.radians(0.014), rel=1e-3)
    assert small.accel_noise_m_s2_sqrt_hz == pytest.approx(175e-6 * GRAVITY_M_S2, rel=1e-3)
    assert small.gyro_range_rad_s == pytest.approx(np.radians(2000), rel=1e-3)
    assert small.accel_range_m_s2 == pytest.approx(24 * GRAVITY_M_S2, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gyro_noise_rad_s_sqrt_hz", 14.0),  # mdeg/s/sqrt(Hz)
        ("accel_noise_m_s2_sqrt_hz", 175.0),  # micro-g/sqrt(Hz)
        ("gyro_walk_rad_s2_sqrt_hz", 2.0),
        ("accel_walk_m_s3_sqrt_hz", 40.0),
        ("gyro_bias_rad_s", 10.0),  # deg/h
        ("accel_bias_m_s2", 20.0),  # mg
        ("gyro_range_rad_s", 2000.0),  # deg/s
        ("accel_range_m_s2", 24_000.0),  # mg
    ],
)
def test_an_imu_in_other_units_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} {value:g} is more than .*, which no unit has; give it in the unit"):
        Imu(**{name: value})


def test_an_imu_beside_any_vehicle_is_refused() -> None:
    with pytest.raises(ValueError, match=r"offset_m .* is more than 10 m from the body; give it in metres"):
        Imu(offset_m=(0.0, 20.0, 0.0))


@pytest.mark.parametrize("kind", [Mount, Gimbal])
def test_a_camera_beside_any_vehicle_is_refused(kind: type) -> None:
    with pytest.raises(ValueError, match=r"offset_m \[30.0, 0.0, 10.0\] is more than 10 m from the body; give it in"):
        kind(offset_m=(30.0, 0.0, 10.0))
