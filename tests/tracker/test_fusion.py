"""The vehicle's filter against closed forms, numerical derivatives, its own claims, and GTSAM."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from tests.tracker.flown_imu import (
    CAM_FROM_BODY,
    body_rate,
    camera_answer,
    specific_force,
    velocity,
    world_from_body,
)
from uavbench.tracker.fusion.kernels import propagate
from uavbench.tracker.fusion.measurements import CameraPose, Height, OpticalFlow, Position
from uavbench.tracker.fusion.state import STANDARD_GRAVITY_M_S2, Estimate, FusionConfig
from uavbench.tracker.fusion.vehicle_filter import VehicleFilter
from uavbench.tracker.geometry_kernels import so3_exp
from uavbench.tracker.protocol import TrackResult
from uavbench.trajectories.pose import Pose, rotation_log

SIGMAS = np.array([0.01] * 3 + [0.005] * 3)
CAMERA_COVARIANCE = np.diag(SIGMAS**2)
QUIET = FusionConfig(camera_slow_share=0.0, camera_bias_m=0.0, camera_bias_rad=0.0)


def ns(t):
    return round(t * 1e9)


def began(config=QUIET, at=0.0, position_m=0.02, attitude_rad=0.01):
    start = Estimate.at_rest(ns(at), world_from_body(at), position_m=position_m, attitude_rad=attitude_rad)
    start = Estimate(
        stamp_ns=start.stamp_ns,
        world_from_body=start.world_from_body,
        velocity_m_s=velocity(at),
        covariance=start.covariance,
    )
    return VehicleFilter(config, CAM_FROM_BODY, start)


def moved(state, error):
    """The true state of a nominal one with this error."""
    out = state.copy()
    out[:6] += error[:6]
    R = state[6:15].reshape(3, 3) @ so3_exp(error[6:9])
    out[6:15] = R.ravel()
    out[15:] += error[9:]
    return out


def difference(true, state):
    """The error of a nominal state."""
    turn = rotation_log(state[6:15].reshape(3, 3).T @ true[6:15].reshape(3, 3))
    return np.concatenate([true[:6] - state[:6], turn, true[15:] - state[15:]])


def some_state(rng):
    state = np.concatenate([rng.normal(size=6), np.zeros(9), 0.05 * rng.normal(size=6), 0.01 * rng.normal(size=6)])
    state[2] = abs(state[2]) + 1.0
    state[6:15] = so3_exp(0.3 * rng.normal(size=3)).ravel()
    return state


def held(state, P, gyro, accel, seconds, config):
    """State and covariance after constant readings."""
    reading = np.concatenate([gyro, accel])
    return propagate(state, P, reading, reading, seconds, config.densities)


# Propagation


def test_a_turning_body_under_constant_force_moves_as_the_closed_form_says():
    """A body that turns at w about z with a constant forward force goes round a circle."""
    w, f, t = 2.0, 3.0, 1.5
    state = Estimate.at_rest(0, Pose.identity(), position_m=1, attitude_rad=1).pack()
    accel = np.array([f, 0.0, STANDARD_GRAVITY_M_S2])
    for dt in (t, t / 7):
        now, P = state, np.eye(21)
        for _ in range(round(t / dt)):
            now, P = held(now, P, np.array([0.0, 0.0, w]), accel, dt, QUIET)
        v = f / w * np.array([np.sin(w * t), 1 - np.cos(w * t), 0.0])
        p = f / w**2 * np.array([1 - np.cos(w * t), w * t - np.sin(w * t), 0.0])
        np.testing.assert_allclose(now[3:6], v, atol=1e-12)
        np.testing.assert_allclose(now[:3], p, atol=1e-12)
        np.testing.assert_allclose(now[6:15].reshape(3, 3), so3_exp(np.array([0, 0, w * t])), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_covariance_moves_by_the_derivative_of_the_motion(seed):
    rng = np.random.default_rng(seed)
    state, gyro, accel, dt = some_state(rng), rng.normal(size=3), 5 * rng.normal(size=3), 0.005
    silent = FusionConfig(
        accel_noise_m_s2_sqrt_hz=0, gyro_noise_rad_s_sqrt_hz=0, accel_walk_m_s3_sqrt_hz=0, gyro_walk_rad_s2_sqrt_hz=0,
    )  # fmt: skip
    densities = silent.densities
    densities[4:6] = 0.0  # of the slow error of the camera's poses
    reading = np.concatenate([gyro, accel])
    after, _ = propagate(state, np.eye(21), reading, reading, dt, densities)
    F = np.empty((21, 21))
    h = 1e-6
    for i in range(21):
        e = np.zeros(21)
        e[i] = h
        F[:, i] = (
            difference(propagate(moved(state, e), np.eye(21), reading, reading, dt, densities)[0], after)
            - difference(propagate(moved(state, -e), np.eye(21), reading, reading, dt, densities)[0], after)
        ) / (2 * h)
    A = rng.normal(size=(21, 21))
    P = A @ A.T
    _, found = propagate(state, P, reading, reading, dt, densities)
    np.testing.assert_allclose(found, F @ P @ F.T, rtol=1e-6, atol=2e-6 * np.abs(P).max())


def test_noise_grows_as_the_integrals_of_white_noise():
    """Velocity by sigma^2 t, position by sigma^2 t^3 / 3 (Sola 2017, appendix E), whatever the step."""
    config = FusionConfig(
        accel_noise_m_s2_sqrt_hz=0.3, gyro_noise_rad_s_sqrt_hz=0, accel_walk_m_s3_sqrt_hz=0, gyro_walk_rad_s2_sqrt_hz=0
    )
    state, t = Estimate.at_rest(0, Pose.identity(), position_m=1, attitude_rad=1).pack(), 2.0
    for n in (10, 400):
        now, P = state, np.zeros((21, 21))
        for _ in range(n):
            now, P = held(now, P, np.zeros(3), np.array([0, 0, STANDARD_GRAVITY_M_S2]), t / n, config)
        assert P[3, 3] == pytest.approx(0.09 * t, rel=1e-9)
        assert P[0, 0] == pytest.approx(0.09 * t**3 / 3, rel=1e-9)
        assert P[0, 3] == pytest.approx(0.09 * t**2 / 2, rel=1e-9)


def test_the_slow_error_of_the_camera_keeps_its_size():
    config = FusionConfig(camera_slow_s=3.0)
    state, P = some_state(np.random.default_rng(0)), np.zeros((21, 21))
    for _ in range(4000):
        state, P = held(state, P, np.zeros(3), np.zeros(3), 0.01, config)
    np.testing.assert_allclose(np.sqrt(np.diag(P)[15:]), 1.0, rtol=1e-6)


# Measurements


MEASURED = {
    "camera": lambda s: CameraPose(
        stamp_ns=0,
        cam_from_world=Pose.exp(np.full(6, 1e-3))
        @ CAM_FROM_BODY
        @ Pose(s[6:15].reshape(3, 3), s[:3]).inverse(),
        covariance=CAMERA_COVARIANCE,
        cam_from_body=CAM_FROM_BODY,
        slow=CAMERA_COVARIANCE + 1e-5 * np.ones((6, 6)),
    ),
    "position": lambda s: Position(
        stamp_ns=0, position_m=s[:3], covariance=np.eye(3), offset_m=np.array([0.1, 0.2, 0.3])
    ),
    "velocity too": lambda s: Position(
        stamp_ns=0, position_m=s[:3], covariance=np.eye(3), velocity_m_s=s[3:6], velocity_covariance=np.eye(3),
        offset_m=np.array([0.1, 0.2, 0.3]),
    ),
    "height": lambda s: Height(stamp_ns=0, height_m=1.0, sigma_m=0.1),
    "flow": lambda s: OpticalFlow(
        stamp_ns=0, flow_rad_s=np.zeros(2), flow_sigma_rad_s=0.1, range_m=1.0, range_sigma_m=0.1
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", MEASURED)
@pytest.mark.parametrize("seed", range(3))
def test_jacobians_are_the_derivatives(kind, seed):
    rng = np.random.default_rng(seed)
    state, gyro, h = some_state(rng), rng.normal(size=3), 1e-6
    measurement = MEASURED[kind](state)
    found = measurement.innovation(state, gyro - state[18:21])
    for i in range(21):
        e = np.zeros(21)
        e[i] = h
        plus, minus = moved(state, e), moved(state, -e)
        slope = -(
            measurement.innovation(plus, gyro - plus[18:21]).residual
            - measurement.innovation(minus, gyro - minus[18:21]).residual
        ) / (2 * h)
        np.testing.assert_allclose(found.H[:, i], slope, rtol=1e-5, atol=1e-5)


def test_flow_of_a_tilted_vehicle_is_not_predicted():
    state = Estimate.at_rest(0, Pose(so3_exp(np.array([1.2, 0, 0])), np.array([0, 0, 1.0])), position_m=1,
                             attitude_rad=1).pack()  # fmt: skip
    assert MEASURED["flow"](state).innovation(state, np.zeros(3)) is None


# The filter


def fly(filter_, seconds, *, camera_hz=15.0, imu_hz=200.0, rng=None, late_s=0.0, sigmas=SIGMAS):
    """Feed a flight's perfect readings, or noisy ones by `rng`; camera poses come late_s after their stamp."""
    waiting = []
    frames = [k / camera_hz for k in range(1, int(seconds * camera_hz) + 1)]
    for k in range(int(seconds * imu_hz) + 1):
        t = k / imu_hz
        gyro, accel = body_rate(t), specific_force(t)
        if rng is not None:
            gyro = gyro + QUIET.gyro_noise_rad_s_sqrt_hz * np.sqrt(imu_hz) * rng.normal(size=3)
            accel = accel + QUIET.accel_noise_m_s2_sqrt_hz * np.sqrt(imu_hz) * rng.normal(size=3)
        filter_.imu(ns(t), gyro, accel)
        while frames and frames[0] <= t:
            waiting.append(frames.pop(0))
        while waiting and waiting[0] + late_s <= t:
            at = waiting.pop(0)
            error = None if rng is None else sigmas * np.random.default_rng(round(at * 1e6)).normal(size=6)
            filter_.camera(ns(at), camera_answer(at, np.diag(sigmas**2), error))
    for at in waiting:
        error = None if rng is None else sigmas * np.random.default_rng(round(at * 1e6)).normal(size=6)
        filter_.camera(ns(at), camera_answer(at, np.diag(sigmas**2), error))
    return filter_


def test_perfect_readings_give_the_true_motion():
    found = fly(began(), 4.0).estimate()
    true = world_from_body(found.stamp_ns * 1e-9)
    np.testing.assert_allclose(found.world_from_body.translation, true.translation, atol=2e-4)
    np.testing.assert_allclose(found.world_from_body.rotation, true.rotation, atol=2e-4)
    np.testing.assert_allclose(found.velocity_m_s, velocity(found.stamp_ns * 1e-9), atol=2e-3)
    np.testing.assert_allclose(found.angular_velocity_rad_s, body_rate(found.stamp_ns * 1e-9), atol=2e-3)


def test_poses_that_come_late_give_the_same_bits_as_in_time():
    in_time, late = (fly(began(), 2.0, rng=np.random.default_rng(5), late_s=s).estimate() for s in (0.0, 0.2))
    assert np.array_equal(in_time.world_from_body.matrix, late.world_from_body.matrix)
    assert np.array_equal(in_time.covariance, late.covariance)


@settings(max_examples=15)
@given(st.randoms(use_true_random=False))
def test_any_order_gives_the_same_bits(random):
    rng = np.random.default_rng(3)
    events = [("imu", k / 100, rng.normal(size=3) * 0.1, np.array([0, 0, 9.8]) + rng.normal(size=3)) for k in range(40)]
    events += [("camera", k / 15 + 0.001, 0.003 * rng.normal(size=6), None) for k in range(5)]
    events += [("height", 0.1234, 1.6, None), ("height", 0.2, 1.4, None)]

    def after(order):
        run = began(FusionConfig())
        for kind, t, a, b in order:
            if kind == "imu":
                run.imu(ns(t), a, b)
            elif kind == "camera":
                run.camera(ns(t), camera_answer(t, CAMERA_COVARIANCE, a))
            else:
                run.take(Height(stamp_ns=ns(t), height_m=a, sigma_m=0.2))
        return run.estimate(ns(0.39))

    shuffled = events[:]
    random.shuffle(shuffled)
    sorted_, mixed = after(sorted(events, key=lambda e: e[1])), after(shuffled)
    assert np.array_equal(sorted_.world_from_body.matrix, mixed.world_from_body.matrix)
    assert np.array_equal(sorted_.covariance, mixed.covariance)


def test_covariances_tell_the_truth_over_a_hundred_seeds():
    """Mean NEES of pose and velocity over seeds within the 95 % band of an honest filter (Bar-Shalom 2001, 5.4).

    The camera's error has the covariance that is claimed in all; 60 % of it is slow, and there is a bias beside it.
    """
    seconds, imu_hz, camera_hz = 3.0, 100.0, 10.0
    config = FusionConfig(
        accel_walk_m_s3_sqrt_hz=0.0, gyro_walk_rad_s2_sqrt_hz=0.0, camera_slow_share=0.6, camera_slow_s=1.0,
        camera_bias_m=0.005, camera_bias_rad=0.003, gate=1 - 1e-12,
    )  # fmt: skip
    spread = np.sqrt(np.diag(config.slow_covariance(CAMERA_COVARIANCE)))
    np.testing.assert_allclose(spread[[0, 5]] ** 2, [0.6e-4 + 2.5e-5, 0.6 * 2.5e-5 + 9e-6])
    stamps = np.arange(int(seconds * imu_hz) + 1) / imu_hz
    rates, forces = np.array([body_rate(t) for t in stamps]), np.array([specific_force(t) for t in stamps])
    end = world_from_body(seconds)
    values = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        first = np.repeat([0.02, 0.05, 0.01, 0.05, 0.01], 3) * rng.normal(size=15)
        pose = world_from_body(0.0)
        start = Estimate(
            stamp_ns=0,
            world_from_body=Pose(pose.rotation @ so3_exp(-first[6:9]), pose.translation - first[:3]),
            velocity_m_s=velocity(0.0) - first[3:6],
            covariance=np.diag(np.repeat([0.02, 0.05, 0.01, 0.05, 0.01], 3) ** 2),
        )
        run = VehicleFilter(config, CAM_FROM_BODY, start)
        slow = spread * rng.normal(size=6)
        keep = np.exp(-1 / (camera_hz * config.camera_slow_s))
        for k, t in enumerate(stamps):
            gyro = rates[k] + first[12:15] + config.gyro_noise_rad_s_sqrt_hz * np.sqrt(imu_hz) * rng.normal(size=3)
            accel = forces[k] + first[9:12] + config.accel_noise_m_s2_sqrt_hz * np.sqrt(imu_hz) * rng.normal(size=3)
            run.imu(ns(t), gyro, accel)
            if k % round(imu_hz / camera_hz) == 0:
                white = np.sqrt(0.4) * SIGMAS * rng.normal(size=6)
                run.camera(ns(t), camera_answer(t, CAMERA_COVARIANCE, slow + white))
                slow = keep * slow + spread * np.sqrt(1 - keep**2) * rng.normal(size=6)
        found = run.estimate()
        error = np.concatenate([
            end.translation - found.world_from_body.translation,
            velocity(seconds) - found.velocity_m_s,
            rotation_log(found.world_from_body.rotation.T @ end.rotation),
            first[9:12] - found.accel_bias_m_s2,
            first[12:15] - found.gyro_bias_rad_s,
        ])  # fmt: skip
        values.append(error @ np.linalg.solve(found.covariance, error))
    low, high = (chi2.ppf(p, 15 * 100) / 100 for p in (0.025, 0.975))
    assert low <= np.mean(values) <= high


def test_a_pose_that_lies_is_refused_and_named():
    run = fly(began(), 1.0)
    before = len(run.verdicts)
    run.camera(ns(1.0), camera_answer(1.0, CAMERA_COVARIANCE, np.array([1.0, 0, 0, 0, 0, 0])))
    told = run.verdicts
    assert len(told) == before + 1
    assert "beyond the gate" in told[-1].why
    assert told[-1].d2 > 22.5
    np.testing.assert_allclose(run.estimate().world_from_body.translation, world_from_body(1.0).translation, atol=1e-3)


def beside(kind, size):
    """A measurement at 0.5 s that errs by a size, and its dimension."""
    body, at = world_from_body(0.5), {"stamp_ns": ns(0.5)}
    if kind == "camera":
        pose = camera_answer(0.5, None, size * np.array([1.0, 0, 0, 0, 0, 0])).cam_from_world
        return CameraPose(**at, cam_from_world=pose, covariance=CAMERA_COVARIANCE, cam_from_body=CAM_FROM_BODY), 6
    if kind == "height":
        return Height(**at, height_m=body.translation[2] + size, sigma_m=0.1), 1
    fix = {**at, "position_m": body.translation + size * np.array([1.0, 0, 0]), "covariance": 0.01 * np.eye(3)}
    if kind == "position":
        return Position(**fix), 3
    return Position(**fix, velocity_m_s=velocity(0.5), velocity_covariance=0.01 * np.eye(3)), 6


@pytest.mark.parametrize("kind", ["camera", "height", "position", "velocity too"])
def test_a_measurement_is_rejected_beyond_twice_the_quantile_of_its_own_dimension(kind):
    run = fly(began(), 0.5)

    def verdict(size):
        other = deepcopy(run)
        measurement, dof = beside(kind, size)
        other.take(measurement)
        assert other.verdicts[-1].dof == dof
        return other.verdicts[-1]

    limit = 4.0 * chi2.ppf(QUIET.gate, beside(kind, 0.0)[1])
    per_square = verdict(10.0).d2 / 10.0**2  # of a large error, before which that of the state is nothing
    inside, beyond = (verdict(np.sqrt(share * limit / per_square)) for share in (0.9, 1.1))
    assert (inside.why, "beyond the gate" in beyond.why) == ("", True)
    assert inside.d2 < limit < beyond.d2


@pytest.mark.parametrize("kind", ["height", "position", "velocity too"])
def test_a_measurement_beyond_its_gate_moves_the_state_as_far_as_one_at_it(kind):
    run = fly(began(), 0.5)

    def after(size):
        other = deepcopy(run)
        other.take(beside(kind, size)[0])
        return other.estimate(), other.verdicts[-1].d2

    gate = chi2.ppf(QUIET.gate, beside(kind, 0.0)[1])
    unmoved, none = after(0.0)
    per_square = after(10.0)[1] / 10.0**2
    at, at_d2 = after(np.sqrt(gate / per_square))
    assert none < 0.1 and at_d2 == pytest.approx(gate, rel=0.05)

    def way(estimate):
        return estimate.world_from_body.translation - unmoved.world_from_body.translation

    for beyond in (1.2, 1.9):
        further, _ = after(beyond * np.sqrt(gate / per_square))
        np.testing.assert_allclose(way(further), way(at), rtol=0.05, atol=1e-6)
        assert (np.diag(further.covariance) >= np.diag(at.covariance) * (1 - 1e-9)).all()


def stds(run):
    return np.sqrt(np.diag(run.estimate().covariance))


def tell(run, *errors_m):
    for error in errors_m:
        run.camera(ns(0.5), camera_answer(0.5, CAMERA_COVARIANCE, np.array([error, 0, 0, 0, 0, 0])))


def test_the_filter_is_doubted_when_so_many_camera_poses_in_a_row_were_refused():
    run = fly(began(replace(QUIET, doubt_after=3)), 0.5)
    tell(run, 1.0, 1.0, 0.0)
    sure = stds(run)
    tell(run, 1.0, 1.0, 1.0)
    np.testing.assert_array_equal(stds(run), sure)
    tell(run, 1.0)
    np.testing.assert_allclose(stds(run) / sure, np.repeat([2.0, 1.0], [9, 6]))


def test_readings_of_other_sensors_that_are_refused_cast_no_doubt_on_the_filter():
    run, other = (fly(began(replace(QUIET, doubt_after=3)), 0.5) for _ in range(2))
    for k in range(90, 100):
        run.take(Height(stamp_ns=ns(k / 200), height_m=100.0, sigma_m=0.1))
    assert sum("beyond the gate" in verdict.why for verdict in run.verdicts) == 10
    for each in (run, other):
        tell(each, 1.0, 1.0)
    np.testing.assert_array_equal(stds(run), stds(other))


def test_a_filter_that_is_wrong_comes_back_to_poses_that_agree():
    """It was told 2 m off with 1 cm of doubt: gated poses must win in the end."""
    start = Estimate.at_rest(0, Pose.identity(), position_m=0.01, attitude_rad=0.01, velocity_m_s=0.001)
    run = VehicleFilter(QUIET, CAM_FROM_BODY, start)
    true = Pose(np.eye(3), np.array([2.0, 0.0, 0.0]))
    for k in range(400):
        run.imu(ns(k / 100), np.zeros(3), np.array([0, 0, STANDARD_GRAVITY_M_S2]))
        if k % 10 == 0:
            pose = CAM_FROM_BODY @ true.inverse()
            run.camera(ns(k / 100), TrackResult(status="ok", cam_from_world=pose, covariance=CAMERA_COVARIANCE))
    assert np.linalg.norm(run.estimate().world_from_body.translation - true.translation) < 0.02


@pytest.mark.parametrize("answer", [
    TrackResult(status="lost"),
    TrackResult(status="ok", cam_from_world=Pose.identity()),
    TrackResult(status="ok", cam_from_world=Pose(np.eye(3), [np.nan, 0, 0]), covariance=CAMERA_COVARIANCE),
    TrackResult(status="ok", cam_from_world=Pose.identity(), covariance=np.full((6, 6), np.nan)),
    TrackResult(status="ok", cam_from_world=Pose.identity(), covariance=np.zeros((6, 6))),
])  # fmt: skip
def test_what_is_no_measurement_changes_nothing(answer):
    run, other = fly(began(), 0.5), fly(began(), 0.5)
    run.camera(ns(0.5), answer)
    assert np.array_equal(run.estimate().covariance, other.estimate().covariance)
    assert np.array_equal(run.estimate().world_from_body.matrix, other.estimate().world_from_body.matrix)


def test_readings_without_a_value_are_refused():
    with pytest.raises(ValueError, match="IMU sample at 7"):
        began().imu(7, np.array([np.nan, 0, 0]), np.zeros(3))
    with pytest.raises(ValueError, match="height_m is not finite"):
        Height(stamp_ns=0, height_m=np.inf, sigma_m=1.0)


def test_a_measurement_at_the_stamp_of_the_last_sample_is_applied_at_once():
    filter_ = began()
    filter_.imu(ns(0.01), body_rate(0.01), specific_force(0.01))
    filter_.take(Height(stamp_ns=ns(0.01), height_m=world_from_body(0.01).translation[2], sigma_m=0.1))
    assert [verdict.kind for verdict in filter_.verdicts] == ["Height"]
    filter_.take(Height(stamp_ns=ns(0.011), height_m=1.0, sigma_m=0.1))
    assert len(filter_.verdicts) == 1, "beyond the last sample there is no reading to move the state with"


def test_a_measurement_older_than_the_history_is_told_as_such():
    run = fly(began(FusionConfig(history_s=0.5)), 2.0)
    before = run.estimate().covariance
    run.take(Height(stamp_ns=ns(0.1), height_m=1.0, sigma_m=0.1))
    assert [v.why for v in run.verdicts if v.kind == "Height"] == ["older than the history"]
    assert np.array_equal(run.estimate().covariance, before)


def test_the_predicted_camera_is_that_of_the_state():
    run = fly(began(), 1.0)
    pose, covariance = run.predict_camera(ns(1.05))
    true = CAM_FROM_BODY @ world_from_body(1.05).inverse()
    assert np.linalg.norm((true @ pose.inverse()).log()) < 0.02
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_the_state_between_samples_lies_between_them():
    run = fly(began(), 1.0, imu_hz=50.0)
    for t in (0.503, 0.51, 0.777):
        found = run.estimate(ns(t)).world_from_body.translation
        np.testing.assert_allclose(found, world_from_body(t).translation, atol=1e-3)


def test_the_state_without_its_covariance_is_the_same_to_the_bit():
    run = fly(began(), 1.0)
    for t in (0.501, 0.777, 1.0, 1.003, 1.2):
        state, rates = run.nominal(ns(t))
        whole = run.estimate(ns(t))
        assert state[:3].tobytes() == whole.world_from_body.translation.tobytes()
        assert state[3:6].tobytes() == whole.velocity_m_s.tobytes()
        assert state[6:15].tobytes() == whole.world_from_body.rotation.tobytes()
        assert state[15:21].tobytes() == np.concatenate([whole.accel_bias_m_s2, whole.gyro_bias_rad_s]).tobytes()
        assert rates.tobytes() == whole.angular_velocity_rad_s.tobytes()


def test_propagation_agrees_with_gtsams_preintegration():
    gtsam = pytest.importorskip("gtsam", reason="gtsam is the oracle here, a development dependency")
    rng = np.random.default_rng(2)
    parameters = gtsam.PreintegrationParams.MakeSharedU(STANDARD_GRAVITY_M_S2)
    config = FusionConfig(accel_walk_m_s3_sqrt_hz=0, gyro_walk_rad_s2_sqrt_hz=0)
    parameters.setAccelerometerCovariance(np.eye(3) * config.accel_noise_m_s2_sqrt_hz**2)
    parameters.setGyroscopeCovariance(np.eye(3) * config.gyro_noise_rad_s_sqrt_hz**2)
    parameters.setIntegrationCovariance(np.zeros((3, 3)))
    theirs = gtsam.PreintegratedImuMeasurements(parameters)
    pose, v = world_from_body(0.3), velocity(0.3)
    state = np.concatenate([pose.translation, v, pose.rotation.ravel(), np.zeros(12)])
    P = np.zeros((21, 21))
    for _ in range(200):
        gyro, accel = 0.5 * rng.normal(size=3), np.array([0, 0, 9.8]) + 2 * rng.normal(size=3)
        theirs.integrateMeasurement(accel, gyro, 0.005)
        state, P = held(state, P, gyro, accel, 0.005, config)
    nav = theirs.predict(
        gtsam.NavState(gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation), v), gtsam.imuBias.ConstantBias()
    )
    np.testing.assert_allclose(state[6:15].reshape(3, 3), nav.attitude().matrix(), atol=1e-4)
    # GTSAM holds the attitude over a step where this integrates it: 200 steps of 5 ms differ by this much.
    np.testing.assert_allclose(state[:3], nav.position(), atol=2e-3)
    np.testing.assert_allclose(state[3:6], nav.velocity(), atol=1e-2)
    # Their covariance is of (attitude, position, velocity) in the body of the end.
    ours = P[np.ix_([6, 7, 8, 0, 1, 2, 3, 4, 5], [6, 7, 8, 0, 1, 2, 3, 4, 5])]
    R = state[6:15].reshape(3, 3)
    T = np.eye(9)
    T[3:6, 3:6] = T[6:9, 6:9] = R.T
    np.testing.assert_allclose(np.sqrt(np.diag(T @ ours @ T.T)), np.sqrt(np.diag(theirs.preintMeasCov())), rtol=0.05)
