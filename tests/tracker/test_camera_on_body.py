"""What the vehicle knows of a gimballed camera: its covariance against drawn readings, and the filter's consistency."""

import numpy as np
import pytest
from scipy.stats import chi2

from tests.tracker.flown_imu import CAM_FROM_BODY, body_rate, specific_force, velocity, world_from_body
from uavbench.tracker.fusion.camera_on_body import KEPT_NS, FixedMount, MeasuredGimbal
from uavbench.tracker.fusion.measurements import CameraPose
from uavbench.tracker.fusion.state import Estimate, FusionConfig
from uavbench.tracker.fusion.vehicle_filter import VehicleFilter
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.gimbal.encoder import Encoder, EncoderReader
from uavbench.trajectories.gimbal.gimbal import Gimbal
from uavbench.trajectories.pose import Pose

PERIOD_NS = 10_000_000
SIGMAS = np.repeat([0.002, 0.001], 3)
QUIET = FusionConfig(camera_slow_share=0.0, camera_bias_m=0.0, camera_bias_rad=0.0, gate=1 - 1e-12)
PERFECT = Encoder(noise_deg=0.0, resolution_deg=0.0, zero_deg=0.0)
NOISY = Encoder(noise_deg=0.3, resolution_deg=0.1, zero_deg=0.0)


def gimbal(encoder, axes="yaw-roll-pitch"):
    return Gimbal(axes=axes, yaw_deg=15.0, offset_m=(0.2, -0.1, 0.05), encoder=encoder)


def joints(t):
    """Angles (3,) of a camera that swings in front of a moving vehicle, rad."""
    return np.array([0.6, 0.2, 0.4]) * np.sin(np.array([1.1, 0.7, 1.7]) * t + [0.3, 1.0, 2.0])


def measured(mount, angles, rng):
    """A gimbal whose true angles (n, 3) have been read every PERIOD_NS."""
    known = MeasuredGimbal(mount)
    for k, row in enumerate(EncoderReader(mount.encoder, len(angles), rng).read(angles)):
        known.read(k * PERIOD_NS, row)
    return known


def test_a_fixed_mount_is_known_without_error():
    known = FixedMount(CAM_FROM_BODY).at(123)
    assert known.cam_from_body is CAM_FROM_BODY
    assert not known.white.any() and not known.constant.any()


@pytest.mark.parametrize("axes", ["yaw-roll-pitch", "roll-pitch", "pitch"])
@pytest.mark.parametrize("at", [0.0, 0.3, 1.0, 1.6])
def test_perfect_encoders_give_the_pose_of_joints_that_turn_evenly(axes, at):
    """Between two readings, at each of them, and shortly after the latest one."""
    mount = gimbal(PERFECT, axes)
    first, rate = np.array([0.4, -0.1, -0.3])[-len(mount.joints) :], np.array([0.02, 0.01, -0.03])[-len(mount.joints) :]
    known = MeasuredGimbal(mount)
    for k in range(2):
        known.read(k * PERIOD_NS, first + k * rate)
    found = known.at(round(at * PERIOD_NS))
    np.testing.assert_allclose(found.cam_from_body.matrix, mount.cam_from_body_at(first + at * rate).matrix, atol=1e-12)
    assert not found.white.any() and not found.constant.any()


def test_of_many_readings_the_two_next_to_a_time_count():
    mount, rng = gimbal(PERFECT), np.random.default_rng(0)
    stamps = np.cumsum(rng.integers(3, 20, size=7)) * 1_000_000
    angles = rng.uniform(-0.5, 0.5, size=(7, 3))
    known = MeasuredGimbal(mount)
    for stamp, row in zip(stamps.tolist(), angles, strict=True):
        known.read(stamp, row)
    for at in np.linspace(stamps[0], stamps[-1], 50).astype(int).tolist():
        expected = mount.cam_from_body(*(np.interp(at, stamps, column) for column in angles.T))
        np.testing.assert_allclose(known.at(at).cam_from_body.matrix, expected.matrix, atol=1e-12)
    late = int(stamps[-1]) + 2_000_000
    ahead = angles[-1] + (angles[-1] - angles[-2]) * 2e6 / (stamps[-1] - stamps[-2])
    np.testing.assert_allclose(known.at(late).cam_from_body.matrix, mount.cam_from_body(*ahead).matrix, atol=1e-12)


def test_a_single_reading_holds_and_without_any_nothing_is_known():
    known = MeasuredGimbal(gimbal(NOISY))
    with pytest.raises(ValueError, match="no reading of the encoders yet"):
        known.at(0)
    known.read(0, np.array([0.1, 0.0, -0.2]))
    expected = gimbal(NOISY).cam_from_body(0.1, 0.0, -0.2).matrix
    np.testing.assert_allclose(known.at(5_000_000).cam_from_body.matrix, expected, atol=1e-15)
    np.testing.assert_allclose(np.trace(known.at(0).white), 3 * NOISY.white_rad**2, rtol=1e-2)
    for bad in (np.zeros(2), np.array([0.0, np.nan, 0.0])):
        with pytest.raises(ValueError, match="a finite angle of each joint"):
            known.read(1, bad)


def test_readings_are_forgotten_when_they_are_old():
    known = MeasuredGimbal(gimbal(NOISY))
    for k in range(200):
        known.read(k * 10**9, np.array([k / 1000, 0.0, 0.0]))
    assert len(known._stamps) == len(known._angles) == KEPT_NS // 10**9 + 1
    for at in (139.0, 150.5, 198.5):
        expected = gimbal(NOISY).cam_from_body(at / 1000, 0.0, 0.0).matrix
        np.testing.assert_allclose(known.at(round(at * 1e9)).cam_from_body.matrix, expected, atol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 1.5])
def test_the_covariance_is_that_of_drawn_readings(share):
    encoder = Encoder(noise_deg=0.3, resolution_deg=0.2, zero_deg=0.2)
    mount, angles = gimbal(encoder), np.array([0.4, -0.2, -0.5])
    true = mount.cam_from_body_at(angles)
    rng, twists = np.random.default_rng(0), []
    for _ in range(1500):
        known = measured(mount, np.tile(angles, (2, 1)), rng).at(round(share * PERIOD_NS))
        twists.append((true @ known.cam_from_body.inverse()).log())
    known = MeasuredGimbal(mount)
    for k in range(2):
        known.read(k * PERIOD_NS, angles)
    claimed = known.at(round(share * PERIOD_NS))
    drawn = np.cov(np.array(twists)[:, 3:].T)
    expected = (claimed.white + claimed.constant)[3:, 3:]
    np.testing.assert_allclose(drawn, expected, atol=0.12 * expected.max())
    assert np.abs(np.array(twists)[:, :3]).max() < 1e-4, "the joints turn the camera about its centre"


def normalized(encoder, modelled, seed):
    """Squared normalized innovations of a tracker's poses that were taken on a gimbal, first the filter's start.

    The IMU and the tracker err as they claim, the encoders as `encoder`; the filter assumes `modelled`.
    """
    rng = np.random.default_rng(seed)
    stamps = np.arange(0, 301) * PERIOD_NS
    angles = np.array([joints(stamp / 1e9) for stamp in stamps])
    known = MeasuredGimbal(gimbal(modelled))
    read = EncoderReader(encoder, len(stamps), rng).read(angles)
    start = np.repeat([0.02, 0.05, 0.01, 0.05, 0.01], 3)
    first, pose = start * rng.normal(size=15), world_from_body(0.0)
    run = VehicleFilter(
        QUIET,
        known,
        Estimate(
            stamp_ns=0,
            world_from_body=pose @ Pose.exp(np.concatenate([np.zeros(3), -first[6:9]])),
            velocity_m_s=velocity(0.0) - first[3:6],
            covariance=np.diag(start**2),
        ),
    )
    for k, stamp in enumerate(stamps.tolist()):
        t = stamp / 1e9
        gyro = body_rate(t) + first[12:15] + QUIET.gyro_noise_rad_s_sqrt_hz * 10.0 * rng.normal(size=3)
        accel = specific_force(t) + first[9:12] + QUIET.accel_noise_m_s2_sqrt_hz * 10.0 * rng.normal(size=3)
        known.read(stamp, read[k])
        run.imu(stamp, gyro, accel)
        if k % 7 == 5:  # late, and between two readings
            seen = stamp - 23_000_000
            true = gimbal(encoder).cam_from_body_at(joints(seen / 1e9)) @ world_from_body(seen / 1e9).inverse()
            noise = Pose.exp(SIGMAS * rng.normal(size=6))
            run.camera(seen, TrackResult(status="ok", cam_from_world=noise @ true, covariance=np.diag(SIGMAS**2)))
    return np.array([verdict.d2 for verdict in run.verdicts])


def test_innovations_are_consistent_where_the_noise_of_the_encoders_is_modelled_and_only_there():
    told = np.concatenate([normalized(NOISY, NOISY, seed) for seed in range(12)])
    low, high = chi2.ppf([0.005, 0.995], 6 * len(told)) / (6 * len(told))
    assert low <= np.mean(told) / 6 <= high
    ignored = np.concatenate([normalized(NOISY, PERFECT, seed) for seed in range(2)])
    assert np.mean(ignored) / 6 > 5


def test_offsets_of_the_joints_can_be_all_of_the_slow_error():
    """Its covariance is then singular, as the joints do not move the camera's centre."""
    encoder = Encoder(noise_deg=0.1, zero_deg=0.2)
    known = measured(gimbal(encoder), np.zeros((2, 3)), np.random.default_rng(0)).at(0)
    pose = CameraPose.claimed(0, CAM_FROM_BODY, np.diag(SIGMAS**2), known, QUIET)
    state = Estimate.at_rest(0, world_from_body(0.0), position_m=0.01, attitude_rad=0.01).pack()
    slow = pose.innovation(state, np.zeros(3)).H[:, 15:]
    np.testing.assert_allclose(slow @ slow.T, known.constant, atol=1e-15)


def test_a_delayed_pose_is_applied_with_the_angles_at_its_own_stamp():
    """With perfect encoders the innovations are consistent without their noise, however the joints turn meanwhile."""
    told = np.concatenate([normalized(PERFECT, PERFECT, seed) for seed in range(4)])
    low, high = chi2.ppf([0.005, 0.995], 6 * len(told)) / (6 * len(told))
    assert low <= np.mean(told) / 6 <= high


def test_the_prediction_includes_the_encoders_noise():
    run_of = {}
    for name, encoder in (("perfect", PERFECT), ("noisy", Encoder(noise_deg=0.3, zero_deg=0.2))):
        known = MeasuredGimbal(gimbal(encoder))
        known.read(0, joints(0.0))
        pose = world_from_body(0.0)
        run = VehicleFilter(QUIET, known, Estimate.at_rest(0, pose, position_m=0.01, attitude_rad=0.01))
        run.imu(0, body_rate(0.0), specific_force(0.0))
        run_of[name] = run.predict_camera(0), known.at(0)
        expected = gimbal(encoder).cam_from_body_at(joints(0.0)) @ pose.inverse()
        np.testing.assert_allclose(run_of[name][0].cam_from_world.matrix, expected.matrix, atol=1e-12)
    (perfect, _), (noisy, known) = run_of["perfect"], run_of["noisy"]
    np.testing.assert_allclose(noisy.covariance - perfect.covariance, known.white + known.constant, atol=1e-12)
    assert np.trace(known.white) > 0 < np.trace(known.constant)
